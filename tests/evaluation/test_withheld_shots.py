"""A decision without fire sends no pellet, in every world; whether it is a miss depends on what the suite counts."""

import dataclasses
import io
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from rich.console import Console

from archerfish.cli.hit_rate_table import print_hit_rates
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.command_limits import gate_limits as limits_of
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.evaluate import Entrant, Ground, Outcome, cells, comparisons, compete
from archerfish.evaluation.report import write_report
from archerfish.evaluation.results import new_results, read_results, write_results
from archerfish.evaluation.suites import Suite, Trials, draw_trials, table_suites
from archerfish.evaluation.transfer import drops
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.errors import InputError
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.sensing.interfaces import Command, Seen, Truth, World, fire_always
from archerfish.simulation.setting import make_world, paper_muzzle
from archerfish.virtual_robot.description import RobotDescription
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.engagement_world import Known, RobotWorld

from .outline import outline

pytestmark = pytest.mark.filterwarnings("ignore:MuJoCo 4 is not installed")

CONDITIONS = assumed_conditions()
PERIOD = CONDITIONS.control_period_s
ENGAGEMENTS, DECISIONS = 3, 30
SENSING = SensingRecord(
    CameraRecord(80.0, 0.0, 3e-4, 1e-3, 1e-3, 0.03, 3.0, 0.1, 0.0, 0.035, 0.002, "exposure"),
    LinkRecord(feedback_rate_hz=1000.0, command_latency=0.012, command_latency_jitter=0.003, feedback_latency=0.002),
)


class EveryFew(NamedTuple):
    """Points straight at what it sees, and fires at every so many decisions."""

    every: Any
    """Decisions from one shot to the next; zero or less fires none, shape ()."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        fire = (self.every > 0.0) & (state % self.every == 0.0)
        return state + 1.0, fire_always(line_of_sight(seen.plate[..., 0, :]))._replace(fire=fire)


def every(decisions: float) -> EveryFew:
    return EveryFew(np.float32(decisions))


def unmoved_by_shots() -> RobotDescription:
    """Return the infantry robot, whose shots neither jolt the barrel nor slow the wheels for the next."""
    robot = load_robot("infantry")
    pitch = dataclasses.replace(robot.gimbal.pitch, recoil_n_m_s=0.0)
    return dataclasses.replace(
        robot,
        gimbal=dataclasses.replace(robot.gimbal, pitch=pitch),
        muzzle=dataclasses.replace(robot.muzzle, droop_per_shot_m_s=0.0),
    )


def build_world(name: str) -> World:
    muzzle = paper_muzzle(CONDITIONS)
    if name == "robot":
        model = gimbal_model(**printed_plants(), period_s=PERIOD)
        known = Known(0.0065, limits_of(gate_limits()), model, muzzle_from_record(muzzle))
        return RobotWorld(unmoved_by_shots(), known, PERIOD)
    sensing = {"sensing": SENSING} if name == "identified" else {}
    return make_world(
        **printed_plants(),
        muzzle=muzzle,
        limits=gate_limits(),
        command_limit="gate",
        conditions=CONDITIONS,
        **sensing,
    )


def suites(counts: str) -> tuple[Suite, ...]:
    """Still and moving targets at 1–2 m."""
    return tuple(dataclasses.replace(each, counts=counts) for each in table_suites(CONDITIONS)[::4])


@pytest.fixture(scope="module", params=["paper", "identified", "robot"])
def ground(request: pytest.FixtureRequest) -> Ground:
    world = build_world(request.param)
    trials = draw_trials(suites("shots"), ENGAGEMENTS, DECISIONS, 3, normals=getattr(world, "normals", 6))
    return Ground(world, trials, "gate", request.param, CONDITIONS)


@pytest.fixture(scope="module")
def outcomes(ground: Ground) -> list[Outcome]:
    """Of a controller that fires always, and of the same one that fires at every second decision."""
    return compete(ground, [Entrant("always", every(1.0), 0), Entrant("half", every(2.0), 0)])


def test_hits_are_those_of_the_same_controller_that_always_fires_where_it_fires(outcomes: list[Outcome]) -> None:
    always, half = outcomes
    assert always.fired.all()
    assert np.array_equal(half.fired, np.broadcast_to(np.arange(DECISIONS) % 2 == 0, half.fired.shape))
    assert np.array_equal(half.hit, always.hit & half.fired)
    # Some pellets that were withheld would have hit, and some that were fired missed.
    assert 0 < half.hit.sum() < always.hit.sum()
    assert half.hit.sum() < half.fired.sum()


def test_in_every_world_shots_and_withheld_ones_are_counted_alike(ground: Ground, outcomes: list[Outcome]) -> None:
    for counts in ("shots", "decisions"):
        counted = dataclasses.replace(ground, trials=dataclasses.replace(ground.trials, suites=suites(counts)))
        for cell, hit in zip(cells(counted, outcomes[1:]), outcomes[1].hit, strict=True):
            assert (cell.shots, cell.withheld, cell.hits) == (45, 45, hit.sum())
            assert (cell.counts, cell.engagements) == (counts, ENGAGEMENTS)
            assert cell.rate == pytest.approx(hit.sum() / (45 if counts == "shots" else 90))
            assert cell.misses_slewing + cell.misses_settled + cell.hits == cell.counted
            assert cell.hits_per_s == pytest.approx(hit.sum() / (ENGAGEMENTS * DECISIONS * PERIOD))
        for cell in cells(counted, outcomes[:1]):
            assert (cell.shots, cell.withheld, cell.counted) == (90, 0, 90)


@pytest.fixture(scope="module")
def made() -> Ground:
    """Twelve engagements, four of each kind of target, of a world that is not shot in."""
    world: Any = build_world("paper")
    return Ground(world, Trials(suites("shots"), *(np.zeros(0) for _ in range(2))), "gate", "paper", CONDITIONS)


def outcome(name: str, share: float, seed: int | None = None, first: int = 0, last: int = 50) -> Outcome:
    """Return what a controller did that fires at a share of the decisions from one to another, and hits with 80 %."""
    generator = np.random.default_rng(5)
    hit, fired = generator.random((2, 20, 50)) < 0.8, generator.random((2, 20, 50)) < share
    fired[..., :first] = fired[..., last:] = False
    return Outcome(name, seed, hit & fired, fired, 1.0)


def test_fired_shots_reach_the_file_the_table_and_the_report(made: Ground, tmp_path: Path) -> None:
    shot = [outcome("history", 1.0, seed=0), outcome("kalman", 0.5), outcome("mute", 0.0)]
    found = cells(made, shot)
    pairs = comparisons(made, shot, "kalman")
    write_results(tmp_path / "results.json", new_results(seed=0, conditions=CONDITIONS, cells=found, comparisons=pairs))
    results = read_results(tmp_path / "results.json")
    assert results.cells == tuple(found)
    assert {cell.paper for cell in results.cells} == {None}
    assert {each.counts for each in (*results.cells, *results.comparisons)} == {"shots"}
    kalman, mute = found[2], found[4]
    assert (mute.shots, mute.hits, mute.withheld, mute.low, mute.high) == (0, 0, 1000, 0.0, 1.0)

    console = Console(file=io.StringIO(), width=80)
    print_hit_rates(results.cells, console)
    printed = " ".join(console.file.getvalue().split())
    assert "static targets, per fired shot" in printed
    assert f"hits of shots {kalman.hits} of {kalman.shots} withheld shots {kalman.withheld} hits/s" in printed
    assert "mute – hits of shots 0 of 0 withheld shots 1000 hits/s 0.0" in printed
    assert "nan" not in printed

    write_report(results, tmp_path / "report.html")
    text = " ".join(outline(tmp_path / "report.html").text.split())
    assert "Table II, static targets: hits per fired shot" in text
    assert f"{kalman.hits} of {kalman.shots} shots, {kalman.withheld} withheld, {kalman.hits_per_s:.1f} hits/s" in text
    assert "Withheld were, of all decisions: History policy 0.0 %, Kalman filter 5" in text
    assert "is neither hit nor miss" in text
    assert "nan" not in text


def test_with_a_robot_fired_shots_stand_beside_the_rates_of_all_ranges(made: Ground, tmp_path: Path) -> None:
    real = tuple(
        dataclasses.replace(each, table=table) for each, table in zip(suites("shots"), ("IV", "V"), strict=True)
    )
    ground = dataclasses.replace(made, trials=dataclasses.replace(made.trials, suites=real), setting="sentry")
    found = cells(ground, [outcome("history", 0.5, seed=0), outcome("kalman", 1.0)])
    write_report(new_results(seed=0, conditions=CONDITIONS, cells=found), tmp_path / "report.html")
    text = " ".join(outline(tmp_path / "report.html").text.split())
    assert f"{found[0].hits} of {found[0].shots} {found[0].withheld} withheld" in text
    assert "Withheld were, of all decisions: History policy" in text.replace("\u00a0", " ")


def test_where_every_decision_counts_the_page_says_what_was_withheld(made: Ground, tmp_path: Path) -> None:
    ground = dataclasses.replace(made, trials=dataclasses.replace(made.trials, suites=suites("decisions")))
    for share, shown in ((0.5, True), (1.0, False)):
        found = cells(ground, [outcome("kalman", share)])
        write_report(new_results(seed=0, conditions=CONDITIONS, cells=found), tmp_path / "report.html")
        text = " ".join(outline(tmp_path / "report.html").text.split())
        assert f"{found[0].hits} / 1 000" in text
        columns = "<th>shots</th><th>withheld</th><th>hits/s</th>"
        assert (columns in (tmp_path / "report.html").read_text()) == shown
        assert "hits per fired shot" not in text


def test_a_controller_that_fires_nothing_is_compared_with_nobody(made: Ground) -> None:
    shot = [outcome("history", 0.0, seed=0), outcome("paper", 0.3, seed=0), outcome("kalman", 1.0)]
    assert [each.controller for each in comparisons(made, shot, "kalman")] == ["paper"] * 2
    ours, theirs = (each.hit.sum(axis=(1, 2)) / each.fired.sum(axis=(1, 2)) for each in shot[1:])
    found = [each.difference for each in comparisons(made, shot, "kalman")]
    assert found == pytest.approx(list(ours - theirs))


def test_a_drop_is_that_of_the_shots_that_count(made: Ground) -> None:
    # None of the robot's shots is a settled one: those can't be compared.
    simulated, robot = outcome("kalman", 1.0), outcome("kalman", 0.5, last=20)
    found = drops(made, [robot], [simulated])
    assert [(each.settled, each.counts) for each in found] == [(False, "shots")] * 2
    rates = [each.hit[0].sum() / each.fired[0].sum() for each in (simulated, robot)]
    assert found[0].difference == pytest.approx(rates[0] - rates[1])


def test_what_a_suite_counts_is_one_of_two(made: Ground) -> None:
    with pytest.raises(InputError, match="counts must be one of decisions, shots, got 'pellets'"):
        suites("pellets")
    both = [
        each
        for counts in ("shots", "decisions")
        for each in cells(
            dataclasses.replace(made, trials=dataclasses.replace(made.trials, suites=suites(counts))),
            [outcome("kalman", 0.5)],
        )
    ]
    with pytest.raises(InputError, match="cells of table II at 1–2 m in paper, gate, count decisions and shots"):
        new_results(seed=0, conditions=CONDITIONS, cells=both)
