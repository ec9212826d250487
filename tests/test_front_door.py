"""The names of `import archerfish as af`, and the ten lines of the page of evaluation."""

import inspect
import pydoc
import re
import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

import archerfish as af

ROOT = Path(__file__).parents[1]


VERBS = ["read_log", "identify_axis", "identify_muzzle", "identify_sensing", "identify_robot", "excite"]
VERBS += ["train", "resume", "evaluate", "rollout", "tune", "export", "make_world", "make_environment"]
NOUNS = ["Recording", "Robot", "PlantRecord", "MuzzleRecord", "Task", "Policy", "TrainConfig", "Results", "InputError"]
NOUNS += ["VirtualRobot"]


def test_the_front_door_has_few_names_which_all_load():
    assert sorted([*VERBS, *NOUNS, "__version__"]) == sorted(af.__all__) == dir(af)
    assert [name for name in VERBS + NOUNS if getattr(af, name).__name__ != name] == []
    with pytest.raises(AttributeError, match=r"'archerfish' has no attribute 'evalute'; it has .*evaluate"):
        _ = af.evalute


def test_the_package_loads_from_a_zip_file(tmp_path, run_python):
    zipped = shutil.make_archive(tmp_path / "package", "zip", ROOT / "src", "archerfish")
    assert run_python("import archerfish; print(archerfish.Task())", PYTHONPATH=zipped) == "Task(motion='any')\n"


@pytest.mark.parametrize("name", VERBS + NOUNS)
def test_a_name_shows_its_arguments_and_says_in_a_line_what_it_is(name):
    thing = getattr(af, name)
    arguments = inspect.signature(thing).parameters
    assert "_" not in arguments
    assert arguments or name == "InputError"
    assert re.match(r"[A-Z].*[.;:]|.*that was given can't be used", inspect.getdoc(thing).splitlines()[0])
    assert name in VERBS or len(str(inspect.signature(thing))) < 500
    assert name not in VERBS or len(pydoc.render_doc(thing).splitlines()) <= 60


@pytest.mark.parametrize("value", [af.Task(), af.Task(motion="paper"), af.Task.load("static"), af.TrainConfig()])
def test_what_is_as_usual_is_not_shown(value):
    assert repr(value) in ("Task(motion='any')", "Task(motion='paper')", "Task(motion='static')", "TrainConfig()")
    changed = value.replace(**({"frames": 6} if isinstance(value, af.TrainConfig) else {"hit_radius_m": 0.05}))
    assert re.fullmatch(r".*(frames=6|, hit_radius_m=0.05)\)", repr(changed))


def test_a_robot_and_a_task_are_given_to_every_verb_alike(tmp_path):
    af.Robot.paper().save(tmp_path / "robot")
    result = SimpleNamespace(record=af.Robot.paper())
    for robot in (None, "paper", tmp_path / "robot", str(tmp_path / "robot"), af.Robot.paper(), result):
        assert af.make_world(robot, "static").name == "paper"
    af.Task(motion="static", period_s=0.04).save(tmp_path / "slow.toml")
    periods = [af.make_world(task=task).period_s for task in ("any", tmp_path / "slow.toml")]
    assert periods == pytest.approx([0.02, 0.04])


def test_an_argument_of_another_type_is_refused_by_its_name(refused):
    for value in (5, None, [5], {"a": 5}, b"x"):
        for verb in (af.evaluate, af.rollout, lambda given: af.export(given, "x.c")):
            refused("controller: expected a name, .*, got one of type", verb, value)
    for verb in (af.identify_axis, af.identify_muzzle):
        refused(f"{verb.__name__}: expected .*, got one of type int; give one", verb, 5)
    refused("^axis: expected a text, got 5; ", af.excite, 5)
    for load in (af.Robot.load, af.Policy.load, af.Results.load, af.Task.load, af.MuzzleRecord.load, af.resume):
        refused("^(folder|path|name): expected a text or a Path, got 5; ", load, 5)
        for name in ("x" * 5000, "x\0", "\ud800"):
            refused("can't be a file's name .*; name another file", load, name)
    for seed in (2.5, -1, "1", True):
        refused("^seed: expected a whole number from 0 on, got ", af.identify_robot, "logs", seed=seed)
    refused("^inputs: expected texts, got ", af.read_log, "log.csv", inputs=[["u"]])
    refused("^from_arrays: expected an array of numbers, got ", af.Recording.from_arrays, [[1], [2, 3]], [1], 0.1)
    refused("got one of type list; give one", af.identify_muzzle, [])
    refused("expected a file or a GimbalLog, got one of type float; give one", af.identify_sensing, 1.0, "plate.csv")


def test_a_message_is_one_line_whatever_a_name_holds(refused, tmp_path):
    refused(r"a.b: expected a folder with pitch.json; ", af.Robot.load, tmp_path / "a\nb")


def test_a_notebook_shows_of_an_error_its_line_alone(refused):
    with pytest.raises(af.InputError) as error:
        af.Task(period_s=0)
    # IPython calls this, if an exception has it, for the lines to show.
    assert error.value._render_traceback_() == [f"InputError: {error.value}"]


def test_the_page_of_evaluation_has_all_fields_of_a_task_with_their_defaults():
    page = (ROOT / "docs" / "evaluation.md").read_text()
    table = page.partition("### Fields")[2].partition("\n## ")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| `?(.*?)`? \|", table, re.MULTILINE))
    usual = {name: getattr(af.Task(name="x"), name) for name in af.Task.__struct_fields__}
    assert list(rows) == list(usual)
    shown = {name: text for name, text in rows.items() if name not in ("name", "lengths_s", "ranges_m")}
    assert shown == {name: re.sub(r"[()\"']", "", str(usual[name])) for name in shown}


def test_ten_lines_lead_to_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("archerfish.evaluation.tuning_search.rates", lambda *_: lambda settings: 0.5)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    lines, later = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "evaluation.md").read_text(), re.DOTALL)[:2]
    exec(lines.replace("./examples", f"{ROOT}/examples").replace("engagements=100", "engagements=4") + later, {})
    assert re.search(r"ours − kalman.*\n.*ours static \(2\.0, 3\.0\) \d+ of 200 ", capsys.readouterr().out, re.DOTALL)
    assert {each.name for each in tmp_path.iterdir()} == {"rates.png", "my-evaluation", "report.html"}
