import hashlib
import importlib.metadata
import json
import sys

import pytest

from archerfish2.plugins import find_plugin, is_plugin

MINE, NEEDY = "import beside\nclass Aim:\n  answer = beside.ANSWER", "\nimport no_such_module\n"
FILES = {"mine": MINE, "other": MINE, "beside": "ANSWER = 42", "broken": "x = 1\nx = = 2\n", "needy": NEEDY}
FAULTS = {
    "./none.py:Aim": "there is no file ./none.py; expected ./FILE.py:NAME",
    "./mine.py:Other": "has no 'Other', but Aim; name one of these",
    "none:Aim": "none:Aim: ModuleNotFoundError: No module named 'none'",
    "none": "controller 'none' is not installed; expected",
    "./broken.py:Aim": "broken.py:Aim: line 2: SyntaxError: invalid syntax",
    "./needy.py:Aim": "needy.py:Aim: line 2: ModuleNotFoundError: No module named 'no_such_module'; correct it",
}


@pytest.fixture
def here(tmp_path, monkeypatch):
    for name, code in FILES.items():
        (tmp_path / f"{name}.py").write_text(code)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_is_run_once_however_it_is_named_and_may_import_what_lies_beside_it(here, monkeypatch):
    first = find_plugin("./mine.py:Aim", "controller")
    same = [find_plugin(spec, "controller") for spec in ("mine:Aim", f"{here}/mine.py:Aim", first.spec)]
    assert all(plugin.value is first.value for plugin in same)
    assert (first.name, first.value.answer, first.file) == ("Aim", 42, str(here / "mine.py"))
    assert first.value.__module__.startswith("archerfish2_plugin_mine_")
    monkeypatch.syspath_prepend(here)
    find_plugin("./other.py:Aim", "controller")
    assert sys.path.pop(0) == str(here)  # a user's own entry stays where it is
    assert (str(here) in sys.path, list(here.glob("__pycache__/mine*"))) == (False, [])


def test_an_edited_file_is_other_code_with_a_digest_of_what_was_run(here):
    first = find_plugin("./mine.py:Aim", "controller")
    (here / "mine.py").write_text(MINE.replace("beside.ANSWER", "43"))
    edited = find_plugin("./mine.py:Aim", "controller")
    assert (first.value.answer, edited.value.answer) == (42, 43)
    both = (here / "mine.py").read_bytes() + (here / "beside.py").read_bytes()
    assert edited.digest == hashlib.sha256(both).hexdigest()
    assert find_plugin(first.value, "controller").digest == first.digest != edited.digest  # of an object, too
    (here / "mine.py").write_text(MINE)
    assert find_plugin("./mine.py:Aim", "controller").value is first.value
    assert find_plugin(type("Aim", (), {"__module__": "none"}), "controller").digest == ""  # without any source


def test_an_edited_file_beside_one_that_imports_it_is_other_code_too(here):
    first = find_plugin("./mine.py:Aim", "controller")
    (here / "beside.py").write_text("ANSWER = 7_000")
    edited = find_plugin("./mine.py:Aim", "controller")
    assert (first.value.answer, edited.value.answer) == (42, 7000)
    assert first.digest != edited.digest


def test_a_module_by_its_name_and_an_object_of_it_have_one_digest(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    (here / "installed_one.py").write_text("def law(robot, task):\n    return None\n")
    named = find_plugin("installed_one:law", "controller")
    assert named.digest == find_plugin(named.value, "controller").digest != ""


def test_an_installed_module_comes_before_a_file_of_its_name(here):
    (here / "json.py").write_text("dumps = 1")
    assert find_plugin("json:dumps", "controller").value is json.dumps
    assert find_plugin("./json.py:dumps", "controller").value == 1


def test_an_installed_module_and_an_entry_point_are_found(monkeypatch):
    assert find_plugin("json:dumps", "controller").file == ""
    entry = importlib.metadata.EntryPoint("fast", "json.decoder:JSONDecoder.decode", "archerfish.controllers")
    monkeypatch.setattr(importlib.metadata, "entry_points", importlib.metadata.EntryPoints([entry]).select)
    plugin = find_plugin("fast", "controller")
    assert (plugin.name, plugin.value.__qualname__) == ("fast", "JSONDecoder.decode")
    assert [is_plugin(spec, "controller") for spec in ("fast", "x:Y", "kalman")] == [True, True, False]


@pytest.mark.parametrize("spec", FAULTS)
def test_what_can_not_be_found_or_run_is_named(here, spec, refused):
    for _ in range(2):
        refused(FAULTS[spec], find_plugin, spec, "controller")
