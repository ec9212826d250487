"""Code of a user's own is found, and what is wrong with it is said in one line that names it."""

import sys
from pathlib import Path

import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.records.extensions import extension_names, find_extension, is_extension, own_code
from archerfish.records.own_plant import find_plant


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def installed(folder: Path, distribution: str, groups: str) -> None:
    """Lay down what an installation leaves of a package that brings entry points."""
    info = folder / f"{distribution}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {distribution}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(groups)


@pytest.mark.parametrize(
    "spec", ["./mine.py:Thing", "mine.py:Thing", "mine:Thing", "inner.mine:Thing", "mine:Box.Thing"]
)
def test_a_file_is_found_by_path_and_by_module_name(here: Path, spec: str) -> None:
    (here / "inner").mkdir()
    for path in (here / "mine.py", here / "inner" / "mine.py"):
        path.write_text("class Box:\n    Thing = 8\nThing = 7\n")
    found = find_extension(spec, "motion")
    assert found.value == (8 if "Box" in spec else 7)
    assert found.name == spec.rpartition(":")[2]
    assert found.file in {here / "mine.py", here / "inner" / "mine.py"}
    assert sorted(each.name for each in here.rglob("*")) == ["inner", "mine.py", "mine.py"]


def test_a_file_may_import_what_lies_beside_it_and_is_read_once(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (here / "beside_the_extension.py").write_text("VALUE = 3\n")
    (here / "mine.py").write_text("from beside_the_extension import VALUE\nclass Thing: value = VALUE\n")
    monkeypatch.setattr(sys, "path", [str(here), *sys.path])  # as by python -m: the order must stay
    before = list(sys.path)
    assert find_extension("./mine.py:Thing", "motion").value.value == 3
    assert find_extension("mine:Thing", "motion").value is find_extension("./mine.py:Thing", "motion").value
    assert sys.path == before


def test_an_installed_module_is_found(here: Path) -> None:
    assert find_extension("fractions:Fraction", "motion").name == "Fraction"


def test_an_entry_point_is_found_by_its_name(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = here / "site"
    installed(site, "their_aim", "[archerfish.controllers]\nsharp = their_aim_module:make\n")
    (site / "their_aim_module.py").write_text("def make(bench): return bench\n")
    monkeypatch.syspath_prepend(str(site))
    assert extension_names("controller") == ("sharp",)
    assert is_extension("sharp", "controller")
    assert not is_extension("sharp", "motion")
    found = find_extension("sharp", "controller")
    assert (found.name, found.value(5)) == ("sharp", 5)
    installed(site, "other_aim", "[archerfish.controllers]\nsharp = other_aim_module:make\n")
    with pytest.raises(InputError, match="'sharp' is brought by several packages, as other_aim_module:make and their"):
        find_extension("sharp", "controller")


def test_an_entry_point_is_of_its_package_and_not_a_file_in_the_working_folder(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    site = here / "site"
    installed(site, "calm_aim", "[archerfish.controllers]\ncalm = calm_aim_module:make\n")
    (site / "calm_aim_module.py").write_text("def make(bench): return 'installed'\n")
    (here / "calm_aim_module.py").write_text("raise RuntimeError('not this one')\n")
    monkeypatch.syspath_prepend(str(site))
    assert find_extension("calm", "controller").value(0) == "installed"


@pytest.mark.parametrize(
    ("spec", "told"),
    [
        ("./mine.py", "says no name, expected the motion's after a colon; write ./mine.py:NAME"),
        ("mine:", "says no name"),
        ("./other.py:Thing", "there is no file ./other.py"),
        ("no_such_module:Thing", "there is no module no_such_module"),
        ("fractions.of:Thing", "there is no module fractions.of"),
        ("nobody", r"there is no motion 'nobody', expected .* \(installed: none\)"),
        ("mine:Thong", "perhaps you meant Thing"),
        ("mine:Q", "it defines Thing, other"),
        ("wrong:x", "wrong: line 2: SyntaxError"),
        ("raising:x", "raising: line 3: ZeroDivisionError: division by zero; mend it"),
        ("leaving:x", "leaving: line 1: SystemExit: 3"),
        ("lacking:x", "lacking: line 1: ModuleNotFoundError: No module named 'no_such_thing'"),
    ],
)
def test_what_can_not_be_found_is_named(here: Path, spec: str, told: str) -> None:
    (here / "mine.py").write_text("class Thing: pass\ndef other(): pass\n")
    (here / "wrong.py").write_text("x = 1\ny = = 2\n")
    (here / "raising.py").write_text("def f():\n\n    return 1 / 0\nx = f()\n")
    (here / "leaving.py").write_text("raise SystemExit(3)\n")
    (here / "lacking.py").write_text("import no_such_thing\n")
    with pytest.raises(InputError, match=told) as raised:
        find_extension(spec, "motion")
    assert "\n" not in str(raised.value)


def test_errors_of_own_code_are_one_line_with_its_place(here: Path) -> None:
    (here / "mine.py").write_text("def f(x):\n    raise ValueError('two\\nlines')\n")
    found = find_extension("mine:f", "motion")
    with pytest.raises(InputError, match=r"^mine:f: line 2: ValueError: two; mend it$"), own_code(found):
        found.value(1)
    with pytest.raises(InputError, match=r"^mine:f: too big$"), own_code(found):
        raise InputError("too big")
    with pytest.raises(KeyboardInterrupt), own_code(found):
        raise KeyboardInterrupt


PLANT = """
import numpy as np
from archerfish.records.plant import PlantRecord
def lag(_, pole=0.9, inputs=1, **facts):
    B = np.full((1, inputs), (1.0 - pole) / inputs)
    return PlantRecord(np.array([[pole]]), B, np.eye(1), np.zeros((1, inputs)), 0, 1e-3, **facts)
def wrong_axis(axis): return lag(axis, axis="yaw")
def unstable(axis): return lag(axis, 1.0)
def two_inputs(axis): return lag(axis, inputs=2)
def matrices(axis): return np.eye(2), np.eye(2)
def misshapen(axis): return PlantRecord(np.eye(2), np.eye(3), np.eye(2), np.eye(2), 0, 1e-3)
ready = lag("pitch")
"""


def test_a_plant_is_a_function_of_the_axis_or_a_record(here: Path) -> None:
    (here / "mine.py").write_text(PLANT)
    for name in ("lag", "ready"):
        plant, source = find_plant(f"mine:{name}", "yaw")
        assert (plant.axis, source.file) == ("yaw", here / "mine.py")
        np.testing.assert_allclose(plant.A, 0.9)


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("wrong_axis", "mine:wrong_axis: gives the plant of the yaw axis for pitch"),
        ("unstable", "mine:unstable: the pitch plant has a pole of magnitude 1, expected less than 1"),
        ("two_inputs", "has 2 inputs, expected one"),
        ("matrices", "gives a tuple for the pitch axis, expected an archerfish.records.plant.PlantRecord"),
        ("misshapen", "mine:misshapen: plant.B must have shape"),
    ],
)
def test_what_is_no_plant_of_a_gimbal_is_refused(here: Path, name: str, told: str) -> None:
    (here / "mine.py").write_text(PLANT)
    with pytest.raises(InputError, match=told):
        find_plant(f"mine:{name}", "pitch")
