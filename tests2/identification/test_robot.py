"""A robot from the folder of its logs, and the commands: what is identified, assumed, named in logs.toml, refused."""

import json
import re

import numpy as np
import pytest

from archerfish2.cli.main import main
from archerfish2.identification.robot import identify_parts, identify_robot
from archerfish2.identification.simulation import simulate
from archerfish2.logs.log import read_log
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord
from archerfish2.robot import Robot

FILES = "sweep", "plate"


@pytest.fixture(scope="module")
def robot_folder(lab_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("robot")
    main(["identify", str(lab_folder), "--out", str(out), "--name", "infantry"])
    return out


def test_a_folder_of_logs_becomes_a_robot_like_that_of_the_first_edition(robot_folder):
    robot = Robot.load(robot_folder)
    assert (robot.name, robot.assumed, len(robot.parts)) == ("infantry", (), 4)
    assert all(each.usable for each in robot.parts.values())
    assert robot.pitch.dc_gain.item() == pytest.approx(
        1.0290796, abs=1e-4
    )  # the plateaus', as the first edition has it
    assert robot.yaw.dc_gain.item() == pytest.approx(1.0001579, abs=1e-4)
    assert 0.02 % robot.pitch.sample_period_s == pytest.approx(0, abs=1e-9)
    assert robot.muzzle.speed == pytest.approx(17.851, abs=0.02)
    assert robot.sensing.camera.time_offset == pytest.approx(6.48e-3, abs=2e-5)
    report = json.loads((robot_folder / "report.json").read_text())
    tables = {each["title"].partition(",")[0]: each["rows"] for each in report["tables"]}
    assert max(abs(row[-1]) for row in tables["Landing points"]) < 5  # % of the mean distances
    assert [row[1] for row in tables["Steps of other sizes"]] == [2, 5, 15, 2, 10, 30]
    pages = {each.name for each in robot_folder.glob("*.html")}
    assert pages == {"robot.html", "pitch.html", "yaw.html", "muzzle.html", "sensing.html"}


def test_a_team_names_its_own_files_columns_and_units(lab_folder, tmp_path, refused):
    for name, file in (("sweep", "a.csv"), ("step_validation", "b.csv")):
        log = read_log(lab_folder / f"yaw_{name}.csv").recordings[0]
        u, y = (np.degrees(each) for each in (log.inputs, log.outputs))
        Recording(u, y, log.period_s, input_names=("cmd",), output_names=("enc",)).write_csv(tmp_path / file, "t_s")
    settings = tmp_path / "logs.toml"
    settings.write_text(
        '[yaw]\nfit=["a.csv"]\nvalidate=["b.csv"]\ninput="cmd"\noutput="enc"\ntime="t_s"\nunit="deg"\n'
        "[limits]\npitch_deg=[-20,12]\nyaw_deg=[-60,60]\nmax_rate_deg_s=600\nmax_acceleration_deg_s2=[5000,3000]\n"
    )
    robot = identify_robot(tmp_path)
    assert robot.assumed == ("pitch", "muzzle", "sensing")
    assert robot.yaw.dc_gain.item() == pytest.approx(1.0, abs=0.05)
    assert robot.limits.pitch.low == pytest.approx(np.radians(-20))
    assert robot.limits.yaw.max_acceleration == pytest.approx(np.radians(3000))
    settings.write_text(settings.read_text().replace("[-60,60]", "[-0.5,0.5]"))
    limits, *_ = identify_parts(tmp_path).report.findings
    assert (limits.code, limits.place) == ("limits", "logs.toml")
    assert re.fullmatch(r"commands of yaw go from -.* to .*°, its limits are -0.5 to 0.5°", limits.message)
    for text, complaint in (
        ("[yaw]\nfits=[]", r"logs.toml: field yaw: .* field fits; correct it; .* may have fit, validate, .*\[limits\]"),
        (
            "[limits]\npitch_deg=[9,-9]\nyaw_deg=[-9,9]\nmax_rate_deg_s=9\nmax_acceleration_deg_s2=9",
            r"logs.toml: \[limits\]: expected the lowest angle before the highest, got 9, -9",
        ),
        ("[yaw", "logs.toml: is not TOML"),
        (
            '[yaw]\nfit=["a.csv"]\nvalidate=["a.csv"]',
            r"logs.toml: \[yaw\] has a.csv both .* and held back, .*; take it",
        ),
        ('[yaw]\nfit=["c.csv"]', "c.csv: there is no such file"),
    ):
        settings.write_text(text)
        refused(complaint, identify_robot, tmp_path)
    (tmp_path / "limits.json").write_text('{"schema": "archerfish.limits/1"}')
    remedy = r"write its figures to \[limits\] in logs.toml, then: archerfish2 identify"
    refused(f"limits.json: field schema: .*; {remedy}", identify_robot, tmp_path)


@pytest.fixture(scope="module")
def one_table(tmp_path_factory):
    """Return a folder with both axes in one table, a sample of it twice, and the angles by other signs."""
    folder, plant, noise = tmp_path_factory.mktemp("logs"), PlantRecord.second_order(4.0, 0.6), np.random.default_rng(0)
    u = np.repeat([0.0, 0.4, -0.2, 0.3, 0.0], 120)
    angle = simulate(plant, u[:, None])[:, 0]
    y = np.stack([-angle, -angle], 1) + 1e-3 * noise.standard_normal((len(u), 2))
    table = folder / "both.csv"
    Recording(u[:, None], y, plant.sample_period_s, output_names=("pitch", "yaw")).write_csv(table)
    lines = table.read_text().splitlines(keepends=True)
    table.write_text("".join([*lines[:50], *lines[49:]]))
    axis = '[{0}]\nfit=["both.csv"]\noutput="-{0}"\n'
    (folder / "logs.toml").write_text(axis.format("pitch") + axis.format("yaw") + "dc_gain=1.0\n")
    for name in ("Gier.CSV", "timing_sweep.csv"):
        (folder / name).write_text("time_s,u,y\n")
    return folder


def test_signs_gain_and_name_are_given_and_what_is_to_be_done_is_said(one_table):
    found = identify_parts(one_table, name="mine")
    assert (found.robot.name, found.robot.assumed) == ("mine", ("muzzle", "sensing", "limits"))
    assert found.robot.pitch.dc_gain.item() == pytest.approx(1.0, abs=0.01)
    assert found.robot.yaw.dc_gain.item() == pytest.approx(1.0, abs=1e-9)
    unused, *others = found.report.findings
    assert unused.message == 'not used: "Gier.CSV", "timing_sweep.csv"'
    assert "expected names are {pitch,yaw}_{sweep,step}" in unused.remedy
    assert [each.code for each in others] == ["time-duplicate"]  # of both axes, and there once
    steps = found.report.next_steps
    assert "pitch_step_validation.csv" in steps[0]
    assert [each for each in steps if re.search(r"--\w", each) and "archerfish2 " not in each] == []


def test_timing_logs_may_be_in_degrees_and_in_the_optical_frame(lab_folder, robot_folder, tmp_path):
    (header, *sweep), (names, *plate) = ((lab_folder / f"timing_{each}.csv").read_text().split() for each in FILES)
    stamps, angles = np.hsplit(np.loadtxt(sweep, delimiter=","), [1])
    rows = np.loadtxt(plate, delimiter=",")
    assert names == "time_s,receive_s,x,y,z"
    rows[:, 2:] = np.stack([-rows[:, 3], -rows[:, 4], rows[:, 2]], 1)
    for name, first, table in zip(FILES, (header, names), (np.hstack([stamps, np.degrees(angles)]), rows), strict=True):
        np.savetxt(tmp_path / f"TIMING_{name}.CSV", table, delimiter=",", header=first, comments="", fmt="%.12g")
    (tmp_path / "logs.toml").write_text('[sensing]\nframe = "optical"\ndegrees = true\n')
    known, found = (Robot.load(robot_folder).sensing.camera, identify_robot(tmp_path).sensing.camera)
    assert found.time_offset == pytest.approx(known.time_offset, abs=1e-6)
    assert found.bearing_sd == pytest.approx(known.bearing_sd, rel=1e-3)


def test_a_robot_is_not_written_among_its_logs(one_table, capsys, refused):
    before = sorted(one_table.iterdir())
    refused("is the folder of the logs.*; choose another", identify_robot, one_table, out=one_table / ".")
    with pytest.raises(SystemExit):
        main(["identify", str(one_table), "--out", str(one_table)])
    assert "is the folder of the logs" in capsys.readouterr().err
    refused("is the folder of the logs", identify_robot, one_table, out=one_table / "robot")
    assert sorted(one_table.iterdir()) == before


def test_folders_without_logs_are_refused(tmp_path, refused):
    refused("gone: there is no such folder", identify_parts, tmp_path / "gone")
    (tmp_path / "Gier.CSV").touch()
    refused('expected .*shots.csv.*, found "Gier.CSV"; name the logs so, or in logs.toml', identify_parts, tmp_path)


def test_an_axis_is_identified_by_a_command_next_to_another(tmp_path, capsys):
    plant, u = PlantRecord.second_order(4.0, 0.6, 0.03, 0.01), np.repeat([0.0, 0.4, -0.2, 0.3, 0.0], 120)
    y = simulate(plant, u[:, None])[:, 0] + 1e-3 * np.random.default_rng(0).standard_normal(len(u))
    Recording.from_arrays(u, y, 0.01).write_csv(tmp_path / "steps.csv")
    log, out = str(tmp_path / "steps.csv"), str(tmp_path / "out")
    for axis in ("yaw", "pitch"):
        main(["identify", "axis", log, "--validate", log, "--axis", axis, "--out", out])
    assert PlantRecord.load(tmp_path / "out" / "yaw.json").axis == "yaw"
    assert json.loads((tmp_path / "out" / "pitch_report.json").read_text())["usable"]
    assert "pitch: what the logs say" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["identify", "axis", log, "--input", "cmd", "--out", str(tmp_path / "none")])
    assert 'no column "cmd"' in capsys.readouterr().err
    assert not list((tmp_path / "none").glob("*.json"))
