"""How often a policy leaves the decision to a simpler controller: counted, printed and reported."""

import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from rich.console import Console

from archerfish.cli.hit_rate_table import print_hit_rates
from archerfish.dynamics.aiming import line_of_sight
from archerfish.evaluation.evaluate import Entrant, Ground, Outcome, cells, compete
from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import new_results, read_results, write_results
from archerfish.evaluation.suites import Trials, draw_trials, motion_suites, table_suites
from archerfish.sensing.interfaces import Command, Seen, Truth, fire_always

from .outline import outline
from .test_withheld_shots import CONDITIONS, DECISIONS, ENGAGEMENTS, build_world

pytestmark = pytest.mark.filterwarnings("ignore:MuJoCo 4 is not installed")


class FallsBack(NamedTuple):
    """Points straight at what it sees, and says at every third decision that another one does."""

    every: Any

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        command = fire_always(line_of_sight(seen.plate[..., 0, :]))
        return state + 1.0, command._replace(fallback=state % self.every == 0.0)


@pytest.mark.parametrize("name", ["paper", "robot"])
def test_in_every_world_the_decisions_are_counted(name: str) -> None:
    world = build_world(name)
    suites = table_suites(CONDITIONS)[::4]
    trials = draw_trials(suites, ENGAGEMENTS, DECISIONS, 3, normals=getattr(world, "normals", 6))
    ground = Ground(world, trials, "gate", name, CONDITIONS)
    found = compete(ground, [Entrant("policy", FallsBack(np.float32(3.0)), 0)])
    assert [cell.fallbacks for cell in cells(ground, found)] == [ENGAGEMENTS * DECISIONS // 3] * 2
    assert found[0].fallback is not None
    assert np.array_equal(
        found[0].fallback, np.broadcast_to(np.arange(DECISIONS) % 3 == 0, (2, ENGAGEMENTS, DECISIONS))
    )


def test_they_reach_the_file_the_table_and_the_report(tmp_path: Path) -> None:
    suites = motion_suites(CONDITIONS, 1.0, names=("strafe",))
    world: Any = build_world("paper")
    ground = Ground(world, Trials(suites, *(np.zeros(0) for _ in range(2))), "gate", "paper", CONDITIONS)
    shape = (len(suites), 20, 50)
    fallback = np.zeros(shape, bool)
    fallback[0, :, :10] = True
    hit, fired = np.random.default_rng(5).random(shape) < 0.8, np.ones(shape, bool)
    shot = [Outcome("policy", 0, hit, fired, 1.0, fallback), Outcome("kalman", None, hit, fired, 1.0)]
    found = cells(ground, shot)
    assert [cell.fallbacks for cell in found] == [200] + 7 * [0]
    write_results(tmp_path / "results.json", new_results(seed=0, conditions=CONDITIONS, cells=found))
    results = read_results(tmp_path / "results.json")
    assert results.cells == tuple(found)

    console = Console(file=io.StringIO(), width=80)
    print_hit_rates(results.cells, console)
    printed = " ".join(console.file.getvalue().split())
    assert "fell back 20.0 % 0.0 % 0.0 % 0.0 %" in printed
    assert printed.count("fell back") == 1

    write_report(results, tmp_path / "report.html")
    text = " ".join(outline(tmp_path / "report.html").text.replace("\u00a0", " ").split())
    said = "Decisions that fell back on a Kalman filter, which had predicted better: Policy of several trackers 5.0 %"
    assert said in text
