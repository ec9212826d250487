"""A user's controllers, target, plant and world: the files of examples, by name and as objects, and their mistakes."""

import ast
import hashlib
import linecache
import re
import sys
import threading
import types
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy import signal

import archerfish as af
from archerfish import authors
from archerfish.dynamics.aiming import aim_at
from archerfish.plugins import find_plugin, registered_name

EXAMPLES = Path(__file__).parents[1] / "examples"
PAGE = EXAMPLES.with_name("docs").joinpath("bring_your_own.md").read_text()
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
    monkeypatch.setattr("archerfish.evaluation.tuning_search.rates", lambda *_: searched.append(1) or (lambda _: 0.5))
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


CELL = "/tmp/ipykernel_7/12.py"
NOTEBOOK = next(each for each in re.findall("```python\n(.*?)```", PAGE, re.DOTALL) if "class Zigzag" in each)
PARTS, CALLS = NOTEBOOK.split("\n\nprint(", 1)
PRODUCTS = """def make(content):
    class Still:
        def position(self, time): return self.place
    def motion(place, speed, uniforms):
        still = Still()
        still.place, still.content = place, content
        return still
    return motion
"""
CONTENTS = [  # of m, with one of two numbers
    "class m:\n    A = {}",
    "class m:\n    @property\n    def a(self): return {}",
    "class m:\n    @staticmethod\n    def a(): return {}",
    "class m:\n    @classmethod\n    def a(cls): return {}",
    "class B:\n    def a(self): return {}\nclass m(B): pass",
    "P = dict(a=[{}])\ndef m(): return P",
    "P = np.array([0.0, {}])\ndef m(): return P",
    "P = np.float32({})\ndef m(): return P",
    "class K: pass\nP = K()\nP.a = {}\ndef m(): return P",
    "class K: A = {}\ndef m(): return K.A",
    "def make(a): return lambda: a\nm = make(np.append(np.zeros(2000), [{}, *range(9)]))",
    "def f(a): return a\nm = functools.partial(f, {})",
    "class K:\n    def __init__(self): self.a = {}\n    def m(self): return self.a\nm = K().m",
    "@functools.lru_cache\ndef m(): return {}",
    "def times(factor):\n    return lambda place, speed, _: factor * place\nm = times({})",
]
LQG = """class LQG:
    compiled = False
    def reset(self, seen, truth=None):
        return None
    def step(self, state, seen):
        return state, self.undefined
"""


@pytest.fixture
def notebook(monkeypatch):
    """Run a cell as IPython does: in a module without a file, its source kept by the name of the cell."""

    def run(code):
        module = types.ModuleType("notebook")
        module.af = af
        monkeypatch.setitem(sys.modules, "notebook", module)
        monkeypatch.setitem(linecache.cache, CELL, (len(code), None, code.splitlines(keepends=True), CELL))
        exec(compile(code, CELL, "exec"), vars(module))
        return module

    return run


def test_the_notebook_of_the_page_runs_and_its_target_moves_as_it_says(notebook, capsys):
    zigzag = notebook(NOTEBOOK).zigzag
    assert re.search(r"zigzag targets.*\('turning', 2\)", capsys.readouterr().out, re.DOTALL)
    shots = af.rollout("no-lead", None, af.Task.of(zigzag).replace(ranges_m=((2, 3),)), engagements=4)
    moved, times = np.diff(shots.target[1::2], axis=1), shots.times + 0.02  # engagements of the cells in turn
    signs = np.where(times[:-1] % 1.0 < 0.49, -1.0, 1.0)
    assert_allclose(moved, moved[:, :1] * (signs / signs[0])[:, None], atol=1e-5)
    assert np.all(np.abs(moved[:, 0, 1]) > 1e-4)


def test_a_target_in_numpy_alone_is_drawn_by_compiled_programs_too(notebook, agree, refused):
    jax, zigzag = pytest.importorskip("jax"), notebook(PARTS).zigzag
    scenario, drawn = af.Task.of(zigzag).scenario(), np.random.default_rng(0).random((2, 3, 10), np.float32)
    times = np.full(3, 0.37, np.float32)
    agree(lambda scenario, uniforms: scenario.draw(uniforms).target.at(times).position, scenario, drawn[0])
    each = jax.vmap(lambda uniforms: scenario.draw(uniforms).target.at(times).position)(drawn)
    assert_allclose(each[1], scenario.draw(drawn[1]).target.at(times).position, atol=1e-5)
    refused("lengths_s: zigzag is sampled, for at most 3 s, got .4.0,.", af.Task(motion=zigzag, lengths_s=(4.0,)).cells)


@pytest.mark.parametrize("code", CONTENTS)
def test_an_object_of_another_content_is_another_one(notebook, code):
    made = [notebook(f"import functools, numpy as np\n{code.format(n)}\n").m for n in (1, 2, 1)]
    names = [registered_name(value, "motion") for value in made]
    assert names[0] == names[2] != names[1]
    assert [find_plugin(name, "motion").value for name in names] == [made[2], made[1], made[2]]


def test_what_is_not_known_by_its_content_is_neither_joined_nor_kept(notebook, tmp_path, monkeypatch, refused):
    monkeypatch.setenv("ARCHERFISH_CACHE", str(tmp_path))
    searched, make = [], notebook(PRODUCTS).make
    monkeypatch.setattr("archerfish.evaluation.tuning_search.rates", lambda *_: searched.append(1) or (lambda _: 0.5))
    opaque = make(threading.Lock())
    for motions, message in (([make(1.0), make(2.0)], "motion differs"), ([opaque, opaque], "motion refers to what")):
        tasks = [af.Task.of(motion).replace(ranges_m=((2, 3),)) for motion in motions]
        first, second = (af.evaluate("kalman", task=task, engagements=2) for task in tasks)
        refused(message, first.join, second)
    assert len(searched) == 4


def test_no_file_names_an_object(notebook, tmp_path, refused):
    task = af.Task.of(notebook(PARTS).zigzag)
    refused("zigzag is an object of this process, which no file can name", task.save, tmp_path / "task.toml")
    (tmp_path / "task.toml").write_text(f'motion = "{task.motion}"')
    refused("code that only a file names is not run", af.Task.load, tmp_path / "task.toml")
    refused("an object of another process; give the object itself", af.Task(motion="<object 12345678>:zigzag").cells)


def test_a_block_has_what_is_seen_at_its_decision(notebook):
    config = af.TrainConfig(observation=("history", notebook(PARTS).turning))
    environment, rng = af.make_environment("tests/infantry", "dynamic", config=config), np.random.default_rng(0)
    uniforms = rng.random((2, environment.uniforms), np.float32)
    fresh = environment.fresh(rng.standard_normal((2, 11), np.float32), uniforms)
    state, step = environment.step(fresh[0], np.ones((2, 2)), rng.standard_normal((2, 11), np.float32), fresh)
    assert_allclose(step.observation[:, -2:], 0.1 * environment.world.see(state.world).gimbal.rate, rtol=1e-6)


def test_mistakes_in_a_notebook_are_named_with_cell_and_line(notebook, refused):
    controller = notebook(LQG).LQG()
    refused(rf"{CELL}:LQG: line 6: AttributeError: 'LQG' object has", af.rollout, controller, task=TASK, engagements=2)
    model = type("PPO", (), {"predict": None})()
    refused("is a PPO with predict; wrap it: authors.Player", af.evaluate, model, task=TASK, engagements=2)


def test_what_authors_need_is_one_module():
    assert [name for name in authors.__all__ if f"`{name}" not in authors.__doc__ or not hasattr(authors, name)] == []
    # The fit of a rigid axis takes the identification apart.
    codes = [path.read_text() for path in EXAMPLES.glob("*.py") if not path.stem.startswith(("rigid_axis", "tutorial"))]
    codes += re.findall("```python\n(.*?)```", PAGE, re.DOTALL)
    nodes = [node for code in codes for node in ast.walk(ast.parse(code))]
    imports = [node for node in nodes if isinstance(node, ast.Import | ast.ImportFrom)]
    modules = {getattr(node, "module", None) or node.names[0].name for node in imports}
    assert {name for name in modules if name.startswith("archerfish")} == {"archerfish", "archerfish.authors"}


def test_the_pages_have_the_files_as_they_are_or_name_them():
    pages = "".join(page.read_text() for page in EXAMPLES.with_name("docs").glob("*.md"))
    files = {path.name: path.read_text() for path in EXAMPLES.glob("*.py")}
    assert [name for name, text in files.items() if f"```python\n{text}```" not in pages and name not in pages] == []
    shown = re.findall(r"```python\n(\"\"\".*?)```", pages, re.DOTALL)
    assert [text for text in shown if text not in files.values()] == []


@pytest.mark.parametrize(("mistake", "message"), list(zip(MISTAKES, MESSAGES, strict=True)))
def test_a_mistake_has_the_message_of_the_page(tmp_path, monkeypatch, mistake, message):
    pytest.importorskip("jax")
    monkeypatch.chdir(tmp_path)
    (file, *_), right, wrong = mistake[0].split(":"), *mistake[1:]
    Path(file).write_text((EXAMPLES / file).read_text().replace(right, wrong, 1))
    noun = {"departure.py": "task", "late_camera.py": "world"}.get(file, "controllers")
    with np.errstate(all="ignore"), pytest.raises(af.InputError, match=".*".join(map(re.escape, message.split("…")))):
        af.evaluate(**{"controllers": "no-lead", "task": TASK, "engagements": 4, noun: f"./{mistake[0]}"})
