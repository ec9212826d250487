"""The pages of the identification: their blocks run, their commands parse, their codes are those of the source."""

import importlib
import re
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tyro

import archerfish as af
from archerfish.cli.main import COMMANDS
from archerfish.identification.robot_files import AXES, axis_logs, read_folder
from archerfish.identification.simulation import simulate

ROOT = Path(__file__).parents[2]
PAGES = {name: (ROOT / "docs" / f"{name}.md").read_text() for name in ("identification", "your_robot")}
PYTHON = re.findall(r"```python\n(.*?)```", PAGES["identification"], re.DOTALL)
PACKAGE = ROOT / "src" / "archerfish"
SOURCES = [path.read_text() for each in ("logs", "identification") for path in (PACKAGE / each).rglob("*.py")]


def test_the_blocks_on_an_axis_and_its_excitation_run_in_their_order(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plant, noise = af.PlantRecord.second_order(8.0, 0.6, 4e-3, 2e-3), np.random.default_rng(0)
    time = 2e-3 * np.arange(700)
    steps = 0.02 * (time > 0.2) - 0.03 * (time > 0.8)
    commands = {"sweep": 0.02 * np.sin(2 * np.pi * (2 * time + 5 * time**2)), "step": steps, "step_2": -0.5 * steps}
    for name, u in commands.items():
        y = simulate(plant, u[:, None])[:, 0] + 1e-4 * noise.standard_normal(len(u))
        af.Recording.from_arrays(u, y, 2e-3).write_csv(f"{name}.csv")
    names = {}
    exec("".join(PYTHON[:3]), names)
    assert names["angle"].shape == (700, 1)
    assert names["step"][-1, 0] == pytest.approx(1.0, abs=0.01)
    assert names["again"].dc_gain.item() == pytest.approx(names["axis"].record.dc_gain.item())
    exec("".join(PYTHON[5:7]), names)
    wanted = {"bode.png", "yaw.json", "yaw.html", "yaw_sweep.csv", "yaw_step_validation.csv"}
    assert wanted <= {each.name for each in tmp_path.iterdir()}


def test_the_blocks_on_muzzle_and_sensing_run_on_a_robot_s_logs(lab_folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for each in lab_folder.glob("*.csv"):
        (tmp_path / each.name).symlink_to(each)
    exec("".join(PYTHON[3:5]), {"af": af})
    assert re.search(r"17\.\d+ m/s.*latency 3\d", capsys.readouterr().out, re.DOTALL)


def test_logs_toml_of_the_page_is_read_as_it_says(tmp_path):
    text = re.search(r"```toml\n(.*?)```", PAGES["your_robot"], re.DOTALL)[1]
    (tmp_path / "logs.toml").write_text(text)
    content, settings = tomllib.loads(text), read_folder(tmp_path)
    for axis in AXES:
        fitted, held_back = axis_logs(tmp_path, axis, getattr(settings, axis))
        assert [each.name for each in fitted] == content[axis]["fit"]
        assert [each.name for each in held_back] == content[axis]["validate"]
    limits = settings.limits.record()
    assert (limits.pitch.low, limits.yaw.max_acceleration) == pytest.approx((np.radians(-25), np.radians(3400)))


def test_each_command_of_the_pages_is_one_that_the_program_takes():
    blocks = re.findall(r"```sh\n(.*?)```|`(archerfish [^`]*)`", "".join(PAGES.values()), re.DOTALL)
    lines = [line for both in blocks for block in both for line in block.splitlines()]
    lines = [line for line in lines if line and not line.endswith("--help")]
    assert len(lines) > 6
    for line in lines:
        words = shlex.split(line)[1:]
        length = 2 if " ".join(words[:2]) in COMMANDS else 1
        module, options = COMMANDS[" ".join(words[:length])]
        if words[length:]:
            tyro.cli(getattr(importlib.import_module(module), options), args=words[length:])


def test_the_page_has_every_code_of_a_finding_or_fault_and_no_other():
    hyphenated = set(re.findall(r'"([a-z]+(?:-[a-z]+)+)"', "".join(SOURCES)))
    rows = re.findall(r"^\| (`[a-z`, -]+`) \|", PAGES["identification"].partition("## Codes")[2], re.MULTILINE)
    codes = {each for row in rows for each in re.findall(r"[a-z]+(?:-[a-z]+)*", row)}
    assert hyphenated - codes == set()
    assert [each for each in codes if f'"{each}"' not in "".join(SOURCES)] == []
