import hashlib
import importlib.metadata
import json
import os
import pickle
import subprocess
import sys
import threading

import pytest

from archerfish.object_digest import object_digest
from archerfish.plugins import find_plugin, is_plugin
from archerfish.targets.user_motion import find_motion

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

LAW = """def law(place, speed, uniforms):
    path = Path()
    path.place = 2.0 * place
    return path
"""
CONTENT = """import functools, numpy as np
class Law:
    def __init__(self): self.names, self.table, self.made = {"a", "b", "c"}, np.ones(2000), functools.partial(max, 1)
    def __call__(self): return "a" in {"a", "b", "c"}
law = Law()
"""


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
    assert first.value.__module__.startswith("archerfish_plugin_mine_")
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


def test_an_object_of_a_module_is_the_same_after_an_edit_of_what_it_does_not_use(here, monkeypatch):
    monkeypatch.syspath_prepend(here)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    digests = []
    for n, code in enumerate((LAW, f"{LAW}\nmore = 1\n", LAW.replace("2.0", "3.0"))):
        (here / f"script_{n}.py").write_text(code)
        digests.append(find_plugin(importlib.import_module(f"script_{n}").law, "motion").digest)
    assert (digests[0] == digests[1] != digests[2], "" in digests) == (True, False)


def test_the_digest_of_an_object_is_the_same_each_time_and_in_another_process():
    code = f"{CONTENT}\nfrom archerfish.object_digest import object_digest as digest\nprint(digest(law), digest(law))"
    seeds = ({**os.environ, "PYTHONHASHSEED": seed} for seed in "123")
    runs = [subprocess.run([sys.executable, "-c", code], env=seed, capture_output=True, check=True) for seed in seeds]
    (digest,) = {text for run in runs for text in run.stdout.decode().split()}
    assert len(digest) == 64


def test_an_object_that_refers_to_what_has_no_content_has_no_digest():
    lock, table = threading.Lock(), {"near": 1.0}
    assert object_digest(lambda: lock) == "" != object_digest(lambda: table)
    table["self"] = table
    assert object_digest(lambda: table) != ""


def test_a_motion_in_numpy_alone_can_be_pickled(here):
    (here / "flat.py").write_text(f"{LAW}class Path:\n    position = lambda self, time: self.place\n")
    motion = find_motion("./flat.py:law").value
    assert type(pickle.loads(pickle.dumps(motion))) is type(motion)


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
