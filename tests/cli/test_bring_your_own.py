"""A controller, a motion and a plant in one file each are evaluated, trained for and reported; faults are told."""

import json
from pathlib import Path

import pytest

pytest.importorskip("jax")

from archerfish.cli.live_run import LiveRun
from archerfish.evaluation.results import read_results

EXAMPLES = Path(__file__).parents[2] / "examples"
CONTROLLER = f"{EXAMPLES / 'two_frames.py'}:TwoFrames"
MOTION = f"{EXAMPLES / 'departure.py'}:Departure"
PLANT = f"{EXAMPLES / 'rigid_gimbal.py'}:gimbal"
FEW = ("--engagements", "2")


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda path: path.stem)
def test_an_example_has_at_most_40_lines_and_is_shown_whole(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 40
    assert f"```python\n{path.read_text()}```\n" in (EXAMPLES.parent / "docs" / "adding.md").read_text()


def test_own_controller_motion_and_plant_are_evaluated_and_reported(command, tmp_path: Path) -> None:
    status, out, err = command(
        "evaluate",
        "--controllers",
        "kalman",
        CONTROLLER,
        "--motion",
        MOTION,
        "--plant",
        PLANT,
        "--robot",
        "rigid",
        *FEW,
    )
    assert status == 0, err
    assert "Departure targets" in out
    assert "TwoFrames" in out
    results = read_results(tmp_path / "runs" / "evaluate" / "results.json")
    assert {(cell.target, cell.motion) for cell in results.cells} == {("static", None), ("dynamic", "Departure")}
    assert {cell.controller for cell in results.cells} == {"perfect", "kalman", "TwoFrames"}
    assert {cell.setting for cell in results.cells} == {"identified-rigid"}
    kalman = [cell for cell in results.cells if cell.controller == "kalman"]
    assert all((cell.paper is None) == (cell.motion is not None) for cell in kalman)
    inputs = json.loads((tmp_path / "runs" / "evaluate" / "config.json").read_text())["provenance"]["inputs"]
    assert set(inputs) == {"two_frames.py", "departure.py", "rigid_gimbal.py"}
    page = (tmp_path / "runs" / "evaluate" / "report.html").read_text()
    assert "Departure targets, at the ranges of Table III" in page
    assert page.count("<th>TwoFrames</th>") + page.count(">TwoFrames<") > 1
    assert "config.json names its file" in page


def test_another_motion_changes_nothing_for_still_targets(command, tmp_path: Path) -> None:
    for out, more in (("with", ("--motion", MOTION)), ("without", ())):
        assert command("evaluate", "--controllers", "no-lead", *FEW, "--out", out, *more)[0] == 0
    rates = [
        {
            (cell.target, cell.range_m): (cell.hits, cell.low)
            for cell in read_results(tmp_path / out / "results.json").cells
        }
        for out in ("with", "without")
    ]
    still, moving = ([key for key in rates[0] if key[0] == kind] for kind in ("static", "dynamic"))
    assert [rates[0][key] for key in still] == [rates[1][key] for key in still]
    assert [rates[0][key] for key in moving] != [rates[1][key] for key in moving]


def test_a_policy_is_trained_for_own_motion_and_plant_and_its_plant_is_kept(
    command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept: list[str] = []
    end = LiveRun.end

    def look(live: LiveRun) -> None:
        kept.extend(sorted(f"{each.parent.name}/{each.name}" for each in (live.folder / "inputs").rglob("*.json")))
        end(live)

    monkeypatch.setattr(LiveRun, "end", look)
    small = ["--ppo.steps", "80", "--ppo.environments", "8", "--ppo.rollout", "6", "--ppo.hidden", "4"]
    small += ["--no-tensorboard"]
    status, _, err = command(
        "train", *small, "--motion", MOTION, "--plant", PLANT, "--robot", "rigid", "--out", "train"
    )
    assert status == 0, err
    assert kept == ["pitch/pitch.json", "yaw/yaw.json"]
    policy = json.loads((tmp_path / "train" / "policy.json").read_text())
    assert policy["training"]["motion"] == MOTION
    assert set(policy["provenance"]["inputs"]) == {"rigid_gimbal.py"}


OWN = """
import numpy as np
from typing import Any, NamedTuple
from archerfish.dynamics.array_namespace import namespace
from archerfish.sensing.interfaces import Command, fire_always

class Plain(NamedTuple):
    gain: Any = np.asarray(1.0)
    @classmethod
    def build(cls, bench): return cls()
    def reset(self, seen, truth=None): return seen.elapsed
    def step(self, state, seen): return state, fire_always(0.0 * seen.angle)

class Raises(Plain):
    def step(self, state, seen): return state, fire_always(self.nothing)
class Branches(Plain):
    def step(self, state, seen):
        if seen.elapsed[0] > 0.0:
            return state, fire_always(0.0 * seen.angle)
        return state, fire_always(seen.angle)
class NotANumber(Plain):
    def step(self, state, seen): return state, fire_always(0.0 * seen.angle / (0.0 * seen.elapsed[..., None]))
class OneAngle(Plain):
    def step(self, state, seen): return state, fire_always(0.0 * seen.angle)._replace(angle=seen.elapsed)
class AngleAlone(Plain):
    def step(self, state, seen): return seen.angle
class OtherState(Plain):
    def step(self, state, seen): return seen.angle, fire_always(seen.angle)
class kalman(Plain): pass
class Unbuilt(NamedTuple): pass
class Ordinary:
    build = classmethod(lambda cls, bench: cls())
    reset = step = lambda self, *_: None
def nothing(bench): return None
def text(bench): return Plain("much")
def failing(bench): return bench.nothing
number = 5

class Still(NamedTuple):
    place: Any
    @classmethod
    def draw(cls, place, speed, chance): return cls(place)
    def position(self, time): return self.place
class Behind(Still):
    def position(self, time): return self.place - 10.0 * time[..., None]
class Flat(Still):
    def position(self, time): return time
class Constant(Still):
    draw = classmethod(lambda cls, place, speed, chance: cls(np.zeros(3)))
class Sudden(Still):
    def position(self, time):
        if time[0] > 0.0:
            return self.place
        return self.place + 1.0
def one_number(place, speed, chance): return speed
def wants_more(place, speed, chance, phase): return Still(place)
class FiresANumber(Plain):
    def step(self, state, seen): return state, fire_always(0.0 * seen.angle)._replace(fire=1.0 + 0.0 * seen.elapsed)
"""


@pytest.fixture
def own(tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(OWN)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Raises", "own:Raises: line 15: AttributeError: 'Raises' object has no attribute 'nothing'; mend it"),
        ("Branches", "own:Branches: line 18: TracerBoolConversionError; it runs compiled"),
        ("OneAngle", "own:OneAngle: step commands angle of shape (5,) for 5 engagements, expected (5, 2)"),
        ("FiresANumber", "own:FiresANumber: step commands fire of type float32, expected true or false for each"),
        ("AngleAlone", "own:AngleAlone: step returns an array, expected (state, Command)"),
        ("OtherState", "own:OtherState: step returns another state than reset: float32[5, 2] after float32[5]"),
        ("kalman", "own:kalman: results already have a controller 'kalman'; call yours something else"),
        ("Unbuilt", "own:Unbuilt: expected a function of a workbench that returns a controller, or a class"),
        ("number", "own:number: expected a function of a workbench"),
        ("Ordinary", "own:Ordinary: builds a Ordinary, expected a NamedTuple"),
        ("nothing", "own:nothing: builds a NoneType without reset and step"),
        ("text", "own:text: Plain.gain is a str, expected an array or a number"),
        ("failing", "own:failing: line 36: AttributeError: 'Workbench' object has no attribute 'nothing'"),
    ],
)
def test_a_controller_with_a_fault_is_refused_by_name(refused, own, name: str, told: str) -> None:
    assert told in " ".join(refused("evaluate", "--controllers", f"own:{name}", *FEW).split())


def test_commands_that_are_no_numbers_are_refused_with_their_decision(command, own, tmp_path: Path) -> None:
    status, _, err = command("evaluate", "--controllers", "own:NotANumber", *FEW)
    assert status == 2
    assert "NotANumber: commands a pitch of nan rad at decision 1, in 16 of 16 engagements" in err
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").rglob("*.json"))


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Behind", "own:Behind: a target is at"),
        ("Flat", "own:Flat: position(time) returns shape (5,) for 5 targets, expected (5, 3)"),
        ("Constant", "own:Constant: Constant.place is of shape (3,), expected an array whose shape begins with"),
        ("Sudden", "own:Sudden: line 52: TracerBoolConversionError; it runs compiled"),
        (
            "one_number",
            "own:one_number: draws a ndarray, expected a NamedTuple of arrays with position(time)",
        ),
        ("wants_more", "own:wants_more: TypeError: wants_more() missing 1 required positional argument"),
        ("number", "own:number: expected a function draw(place, speed, chance)"),
    ],
)
def test_a_motion_with_a_fault_is_refused_by_name(refused, own, name: str, told: str) -> None:
    assert told in " ".join(refused("evaluate", "--controllers", "no-lead", "--motion", f"own:{name}", *FEW).split())


def test_a_plant_in_a_folder_or_of_neither_kind(refused, tmp_path: Path) -> None:
    assert "is no folder with pitch.json" in refused("evaluate", "--plant", "nowhere", "--robot", "me")
    assert "--robot must name the robot that" in refused("evaluate", "--plant", PLANT)
    assert "--plant gives both axes" in refused("evaluate", "--plant", PLANT, "--pitch", "a.json", "--robot", "me")


def test_one_controller_given_twice_is_refused(refused, own) -> None:
    assert "Plain is given twice" in refused("evaluate", "--controllers", "own:Plain", "./own.py:Plain", *FEW)


def test_a_controller_of_an_installed_package_is_evaluated_by_its_name(
    command, own, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "site" / "steady_aim-2.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: steady_aim\nVersion: 2.0\n")
    (info / "entry_points.txt").write_text("[archerfish.controllers]\nsteady = steady_aim:Plain\n")
    (tmp_path / "site" / "steady_aim.py").write_text(OWN)
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    status, out, err = command("evaluate", "--controllers", "steady", "own:Plain", *FEW)
    assert status == 0, err
    assert "steady" in out
