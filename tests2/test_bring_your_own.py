"""A user's controllers, target, plant and world: the files of examples2, by name and as objects, and their mistakes."""

import hashlib
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

import archerfish2 as af
from archerfish2.dynamics.aiming import aim_at
from archerfish2.plugins import find_plugin

EXAMPLES = Path(__file__).parents[1] / "examples2"
PAGE = EXAMPLES.with_name("docs2").joinpath("bring_your_own.md").read_text()
CONTROLLER, CAMERA = f"{EXAMPLES}/two_frames.py:two_frames", f"{EXAMPLES}/late_camera.py:late_camera"
TASK = af.Task.load("static").replace(ranges_m=((2, 3),))
MISTAKES = [
    ("two_frames.py:two_frames", "        delay", "        age = age if new.any() else age\n        delay"),
    ("two_frames.py:two_frames", "0.0 * age", "__import__('numpy').maximum(0.0, 0.0 * age)"),
    ("line_fit.py:LineFit", "(self, robot, task)", "(self)"),
    ("two_frames.py:two_frames", "return (place, velocity, age), aim", "return aim"),
    ("two_frames.py:two_frames", "muzzle).angle", "muzzle).angle[..., 0]"),
    ("two_frames.py:two_frames", "return (place, velocity, age)", "return (place, velocity, age, age)"),
    ("two_frames.py:two_frames", "return first.place", "return 0.0 / (0.0 * first.place)"),
    ("two_frames.py:two_frames", "measured, velocity)", "xp.sqrt(measured - 0.1), velocity)"),
    ("departure.py:departure", "[x, y", "[x - 20.0 * xp.abs(driven), y"),
    ("late_camera.py:late_camera", "(robot, task))", "(robot, task.replace(period_s=0.04)))"),
    ("two_frames.py", "", ""),
]
MESSAGES = re.findall(r"^\| .* \| `(.*)` \|$", PAGE, re.MULTILINE)[-len(MISTAKES) :]


def example(name):
    return find_plugin(f"{EXAMPLES}/{name}", "example").value


@pytest.mark.parametrize("name", ["two_frames.py:two_frames", "line_fit.py:LineFit"])
def test_a_controller_aims_at_a_target_that_stands(name):
    made = example(name)(af.Robot.paper(), TASK)
    shots = af.rollout(made, task=TASK, engagements=4)
    assert_allclose(shots.command.angle, aim_at(shots.target, af.Robot.paper().muzzle_model()).angle, atol=1e-5)
    given = {"by name": f"{EXAMPLES}/{name}", "function": example(name), "object": made}
    cells = af.evaluate(given, task=TASK, engagements=4).cells
    assert [(each.controller, each.hits) for each in cells] == [(each, shots.hit.sum()) for each in given]


def test_a_target_moves_as_its_file_says():
    task = af.Task.load(f"{EXAMPLES}/departure.py:departure").replace(ranges_m=((2, 3),))
    cells, shots = (each(CONTROLLER, task=task, engagements=4) for each in (af.evaluate, af.rollout))
    assert [each.motion for each in cells.cells] == ["departure"]
    for each in np.abs(np.diff(shots.target, axis=1)):
        begun = np.argmax(each[:, 1] > 0.0)
        assert 0 < begun <= 25
        assert_allclose(each[begun + 1 :], [[0.0, each[-1, 1], 0.0]] * (48 - begun), rtol=1e-3)


def test_an_edited_target_is_evaluated_and_tuned_for_as_it_is_now(tmp_path, monkeypatch):
    monkeypatch.setenv("ARCHERFISH_CACHE", str(tmp_path / "cache"))
    searched, file, spec = [], tmp_path / "mine.py", f"{tmp_path}/mine.py:departure"
    monkeypatch.setattr("archerfish2.evaluation.tuning.rates", lambda *_: searched.append(1) or (lambda _: 0.5))
    text, hits = (EXAMPLES / "departure.py").read_text(), []
    for content in (text, text.replace("side * speed", "8.0 * side * speed"), text):
        file.write_text(content)
        results = af.evaluate("kalman", task=af.Task.load(spec).replace(ranges_m=((2, 3),)), engagements=4)
        assert results.motions["departure"] == hashlib.sha256(content.encode()).hexdigest()
        hits.append(results.cells[-1].hits)
    assert (hits[0] == hits[2] > hits[1], len(searched)) == (True, 2)


def test_a_plant_answers_commands_as_its_differential_equation():
    robot = af.Robot.paper().replace(yaw=f"{EXAMPLES}/rigid_gimbal.py:gimbal")
    plant = example("rigid_gimbal.py:gimbal")("yaw")
    assert robot.digest() == af.Robot.paper().replace(yaw=plant.replace(axis="yaw")).digest()
    inertia, stiffness, damping = example("rigid_gimbal.py:AXES")["yaw"]
    shots = af.rollout(CONTROLLER, robot, TASK, engagements=4)
    for command, yaw in zip(shots.in_force[..., 1], shots.shot.angle[..., 1], strict=True):
        late, system = np.append([0.0] * 4, np.repeat(command, 20))[:1001], ([stiffness], [inertia, damping, stiffness])
        assert_allclose(yaw, signal.lsim(system, late, 1e-3 * np.arange(1001), interp=False)[1][20::20], atol=1e-5)


def test_a_world_is_found_by_name_or_given_and_its_camera_is_late():
    plain, late = (af.rollout(CONTROLLER, task=TASK, world=each, engagements=4) for each in (None, CAMERA))
    assert not late.seen.frames.received[:, 0].any()
    assert_array_equal(late.seen.frames.position[:, 1:], plain.seen.frames.position[:, :-1])
    make = example("late_camera.py:late_camera")
    for world in (CAMERA, make, make(af.Robot.paper(), TASK)):
        (cell,) = af.evaluate(CONTROLLER, task=TASK, world=world, engagements=4).cells
        assert (cell.world, cell.hits) == ("paper, late camera", late.hit.sum())


def test_the_page_has_the_files_as_they_are():
    # The fit of a rigid axis is too long for a page, which names it.
    files = {path.name: path.read_text() for path in EXAMPLES.glob("*.py") if not path.stem.startswith("rigid_axis")}
    pages = "".join(each.read_text() for each in (EXAMPLES.parent / "docs2").glob("*.md"))
    assert [name for name, text in files.items() if f"```python\n{text}```" not in pages or text.count("\n") > 40] == []


@pytest.mark.parametrize(("mistake", "message"), list(zip(MISTAKES, MESSAGES, strict=True)))
def test_a_mistake_has_the_message_of_the_page(tmp_path, monkeypatch, mistake, message):
    pytest.importorskip("jax")
    monkeypatch.chdir(tmp_path)
    (file, *_), right, wrong = mistake[0].split(":"), *mistake[1:]
    Path(file).write_text((EXAMPLES / file).read_text().replace(right, wrong, 1))
    noun = {"departure.py": "task", "late_camera.py": "world"}.get(file, "controllers")
    with np.errstate(all="ignore"), pytest.raises(af.InputError, match=".*".join(map(re.escape, message.split("…")))):
        af.evaluate(**{"controllers": "no-lead", "task": TASK, "engagements": 4, noun: f"./{mistake[0]}"})
