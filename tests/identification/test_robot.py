"""A robot from the folder of its logs, and the commands: what is identified, assumed, named in logs.toml, refused."""

import json
import re
import shutil

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.identification.robot import identify_robot
from archerfish.identification.simulation import simulate
from archerfish.logs.log import read_log
from archerfish.logs.recording import Recording
from archerfish.paper.gimbal import gate_limits
from archerfish.records.plant import PlantRecord
from archerfish.robot import Robot

FILES = "sweep", "plate"


@pytest.fixture(scope="module")
def robot_folder(lab_folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("robot")
    main(["identify", str(lab_folder), "--out", str(out), "--name", "infantry"])
    return out


def test_a_folder_of_logs_becomes_a_robot_like_that_of_version_0_1(robot_folder):
    robot = Robot.load(robot_folder)
    assert (robot.name, robot.assumed, len(robot.parts)) == ("infantry", (), 4)
    assert all(each.usable for each in robot.parts.values())
    # Version 0.1 took plateaus of a second and more, and so leaves out the rests between.
    assert robot.pitch.dc_gain.item() == pytest.approx(1.0290796, abs=1e-3)
    assert robot.yaw.dc_gain.item() == pytest.approx(1.0001579, abs=1e-3)
    assert 0.02 % robot.pitch.sample_period_s == pytest.approx(0, abs=1e-9)
    assert robot.muzzle.speed == pytest.approx(17.851, abs=0.02)
    assert robot.sensing.camera.time_offset == pytest.approx(6.48e-3, abs=2e-5)
    report = json.loads((robot_folder / "report.json").read_text())
    tables = {each["title"].partition(",")[0]: each["rows"] for each in report["tables"]}
    assert max(abs(row[-1]) for row in tables["Landing points"]) < 5  # % of the mean distances
    assert [row[1] for row in tables["Steps of other sizes"]] == [2, 5, 15, 2, 10, 30]
    pages = {each.name for each in robot_folder.glob("*.html")}
    assert pages == {"robot.html", "pitch.html", "yaw.html", "muzzle.html", "sensing.html"}


LIMITS = "[limits]\npitch_deg=[9,-9]\nyaw_deg=[-9,9]\nmax_rate_deg_s=9\nmax_acceleration_deg_s2=9"
FAULTS = {
    "[yaw]\nfits=[]": r"logs.toml: field yaw: .* field fits; perhaps you meant fit; .* may have fit, val.*\[limits\]",
    LIMITS: r"logs.toml: \[limits\]: expected the lowest angle before the highest, got 9, -9",
    "[yaw": "logs.toml: is not TOML",
    '[yaw]\nfit=["a.csv"]\nvalidate=["a.csv"]': r"logs.toml: \[yaw\] has a.csv both .* and held back, .*; take it",
    '[yaw]\nfit=["c.csv"]': "c.csv: there is no such file",
    '[yaw]\nfit=["a.csv"]\nfiles={"c.csv"={input="u"}}': r"logs.toml: \[yaw.files.\"c.csv\"\] is of none of its logs",
    '[muzzle]\ncolumns={pitch="p"}': r"there is no pitch, expected some of pitch_deg, yaw_deg, .* missed",
}


def test_each_page_has_the_verdicts_of_parts_and_links_to_pages_that_are_there(robot_folder):
    for page in robot_folder.glob("*.html"):
        links = re.findall(r'<a class="(\w*)" href="([^"]+)">', page.read_text())
        assert all((robot_folder / target).is_file() for _, target in links)
        parts = [("good", f"{part}.html") for part in ("pitch", "yaw", "muzzle", "sensing")]
        assert links == [("", "robot.html")] * (page.name != "robot.html") + parts


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
    robot = identify_robot(tmp_path).record
    assert robot.assumed == ("pitch", "muzzle", "sensing")
    assert robot.yaw.dc_gain.item() == pytest.approx(1.0, abs=0.05)
    assert robot.limits.pitch.low == pytest.approx(np.radians(-20))
    assert robot.limits.yaw.max_acceleration == pytest.approx(np.radians(3000))
    for text, complaint in FAULTS.items():
        settings.write_text(text)
        refused(complaint, identify_robot, tmp_path)


def write_axis(path, change=lambda u, y: (u, y), names=("u", "y"), time="time_s"):
    """Write a log of steps of an axis, changed, and return its folder."""
    plant, noise = PlantRecord.second_order(4.0, 0.6, 0.01, 2e-3), np.random.default_rng(0)
    u = np.repeat([0.0, 0.4, -0.2, 0.3, 0.0, 0.2], 200)
    y = simulate(plant, u[:, None])[:, 0] + 1e-4 * noise.standard_normal(len(u))
    path.parent.mkdir(parents=True, exist_ok=True)
    u, y = change(u, y)
    Recording.from_arrays(u, y, 2e-3, input_names=names[:1], output_names=names[1:]).write_csv(path, time)
    return path.parent


WRONG = {
    'output = "-y"': lambda u, y: (u, -y),
    'input = "y" and output = "u"': lambda u, y: (y, u),
    'input_unit = "deg"': lambda u, y: (np.degrees(u), y),
    'output = "-y" and output_unit = "deg"': lambda u, y: (u, -np.degrees(y)),
}


@pytest.mark.parametrize(
    "remedy", [pytest.param(remedy, marks=[pytest.mark.slow] * ("and" not in remedy)) for remedy in WRONG]
)
def test_wrong_columns_signs_and_units_are_a_verdict_whose_remedy_helps(remedy, tmp_path, refused):
    folder = write_axis(tmp_path / "logs" / "yaw_step.csv", WRONG[remedy])
    found = identify_robot(folder, out=tmp_path / "robot")
    assert found.report.next_steps[0] == f"yaw: Write {remedy} to [yaw] in logs.toml."
    assert "Not usable" in (tmp_path / "robot" / "yaw.html").read_text()
    refused(r"robot.yaw.json: is not usable: .*; Write .* to \[yaw\] in logs.toml", Robot.load, tmp_path / "robot")
    (folder / "logs.toml").write_text("[yaw]\n" + remedy.replace(" and ", "\n"))
    again = identify_robot(folder, out=tmp_path / "robot").record
    assert (again.parts["yaw"].usable, again.yaw.dc_gain.item()) == (True, pytest.approx(1.0, abs=0.01))


def test_a_part_that_can_not_be_used_is_assumed_with_a_verdict_and_the_others_are_kept(tmp_path, refused):
    logs, out = write_axis(tmp_path / "logs" / "yaw_step.csv"), tmp_path / "robot"
    write_axis(logs / "pitch_step.csv", lambda u, y: (u, -y))
    rows = [f"0,3,{height}" for height in (0.01, -0.02, 0.0, 0.02, -0.01, 0.015)]
    (logs / "shots.csv").write_text("\n".join(["pitch_deg,plane_distance_m,hit_height_m", *rows]))
    for name in ("sweep", "plate", "target"):
        (logs / f"timing_{name}.csv").write_text("time_s\n0\n")
    limits = gate_limits().replace(source="a data sheet")
    limits.save(logs / "limits.json")  # version 0.1 wrote the same under another schema
    text = (logs / "limits.json").read_text().replace("limits/2", "limits/1")
    (logs / "limits.json").write_text(text)
    found = identify_robot(logs, out=out)
    usable = {part: verdict.usable for part, verdict in found.record.parts.items()}
    assert usable == {"pitch": False, "yaw": True, "muzzle": False, "sensing": False}
    assert (found.record.assumed, found.record.limits.source) == (("muzzle", "sensing"), "a data sheet")
    steps = "\n".join(found.report.next_steps)
    assert "muzzle: measure speed_m_s of each shot, or shoot at 2 target distances that differ" in steps
    assert {each.name for each in out.glob("*.html")} == {f"{part}.html" for part in ("robot", *usable)}
    assert '<a class="bad" href="muzzle.html">muzzle: not usable</a>' in (out / "robot.html").read_text()
    refused(r"pitch.json: is not usable: The steady gain is -1: .*; Write output", Robot.load, out)
    refused(r"pitch.json: is not usable: pitch has a steady gain of -1", Robot.load, out, accept_unusable=True)
    write_axis(logs / "pitch_step.csv")
    (logs / "limits.json").write_text(text.replace("max_rate", "rate"))
    again = identify_robot(logs, out=out)
    refused(r"robot: muzzle: is not usable: .*; measure speed_m_s .*, or accept the paper's muzzle in", Robot.load, out)
    assert Robot.load(out, accept_unusable=True).assumed == ("muzzle", "sensing", "limits")
    assert "limits: take it out, or begin logs.toml with your figures: limits = {" in repr(again)


def test_what_logs_toml_names_and_no_log_has_is_refused_whatever_else_is_usable(tmp_path, refused):
    folder = write_axis(tmp_path / "logs" / "pitch_step.csv")
    write_axis(folder / "yaw_step.csv")
    (folder / "logs.toml").write_text('[pitch]\noutput = "angel"')
    refused('pitch_step.csv: .* no column "angel"; the columns are "time_s", "u", "y"', identify_robot, folder)
    for name in ("pitch_step.csv", "yaw_step.csv"):
        (folder / name).unlink()
    (folder / "shots.csv").write_text("elevation,plane_distance_m,hit_height_m\n0,3,0.01\n")
    for named, complaint in (("elevatoin", 'no column "elevatoin"'), ("elevation", "1 shots are too few")):
        (folder / "logs.toml").write_text(f'[muzzle]\ncolumns = {{pitch_deg = "{named}"}}')
        refused(complaint, identify_robot, folder)


def test_a_first_line_for_logs_toml_names_the_columns_of_a_log(tmp_path, refused):
    folder = write_axis(tmp_path / "logs" / "monday.csv", names=("cmd", "angle"), time="stamp_s")
    complaint = r'expected .*, found "monday.csv"; monday.csv has "stamp_s", "cmd", "angle"; name the logs so, or say'
    error = refused(complaint, identify_robot, folder)
    (folder / "logs.toml").write_text(str(error).partition("for instance: ")[2])
    assert identify_robot(folder).record.parts["yaw"].usable
    (folder / "logs.toml").unlink()
    (folder / "monday.csv").rename(folder / "pitch_step.csv")
    error = refused(r'no column "time_s".*begin logs.toml with pitch = ', identify_robot, folder)
    line = str(error).partition("begin logs.toml with ")[2].partition(", if all")[0]
    (folder / "logs.toml").write_text(line)
    assert identify_robot(folder).record.parts["pitch"].usable


def test_a_signal_whose_name_says_degrees_is_in_degrees(tmp_path):
    folder = write_axis(tmp_path / "logs" / "yaw_step.csv", lambda u, y: (np.degrees(u), y), names=("u_deg", "angle"))
    (folder / "logs.toml").write_text('yaw = {input = "u_deg", output = "angle"}')
    assert identify_robot(folder).record.yaw.dc_gain.item() == pytest.approx(1, abs=0.05)


def test_steps_of_other_sizes_are_simulated_at_the_period_of_the_plant(tmp_path):
    fits = []
    for every in (1, 4):
        folder = write_axis(tmp_path / f"logs{every}" / "yaw_step.csv")
        fine = write_axis(tmp_path / f"fine{every}" / "yaw_step_5deg.csv")
        rows = (folder / "yaw_step.csv").read_text().splitlines(keepends=True)
        (folder / "yaw_step.csv").write_text("".join([rows[0], *rows[1::every]]))
        (fine / "yaw_step_5deg.csv").rename(folder / "yaw_step_5deg.csv")
        (table,) = [table for table in identify_robot(folder).report.tables if "other sizes" in table.title]
        fits.append(table.rows[0][2])
    assert min(fits) > 90  # 20 and less if the samples are taken as those of the plant


def test_of_two_logs_of_one_name_the_one_that_is_not_fitted_is_named(tmp_path):
    write_axis(tmp_path / "logs" / "run" / "yaw_step.csv")
    folder = write_axis(tmp_path / "logs" / "yaw_step.csv", lambda u, y: (0.5 * u, 0.5 * y))
    (folder / "logs.toml").write_text('[yaw]\nfit = ["run/yaw_step.csv"]\n')
    unused, *_ = identify_robot(folder).report.findings
    assert unused.message == 'not used: "yaw_step.csv"'


def test_degrees_that_are_said_to_be_radians_show_in_commands_of_many_turns(tmp_path):
    folder = write_axis(tmp_path / "logs" / "pitch_step.csv", lambda u, y: (np.degrees(u), np.degrees(y)))
    limits, *_ = identify_robot(folder).report.findings
    assert limits.message == "commands of pitch go from -657 to 1.31e+03°, expected -90 to 90°"
    (folder / "logs.toml").write_text('[pitch]\nunit = "deg"\n')
    assert identify_robot(folder).report.findings == ()
    (folder / "logs.toml").write_text(f'[pitch]\nunit = "deg"\n{LIMITS.replace("9,-9", "-9,9")}')
    (limits,) = identify_robot(folder).report.findings
    assert limits.message == "commands of pitch go from -11.5 to 22.9°, its limits are -9 to 9°"


def test_a_length_that_is_not_given_is_assumed_on_the_first_page_which_has_the_offsets(tmp_path):
    rng, distance = np.random.default_rng(0), np.repeat([1.0, 2.0, 3.0], 20)
    speed, (up, left) = rng.normal(20.0, 0.3, 60), rng.normal([[0.01], [-0.02]], 0.003, (2, 60))
    height = distance * up - 9.81 / 2 * (distance / speed) ** 2
    rows = np.column_stack([0.0 * up, distance, height, left * distance, speed])
    header = "pitch_deg,plane_distance_m,hit_height_m,lateral_m,speed_m_s"
    np.savetxt(tmp_path / "shots.csv", rows, "%.4f", delimiter=",", header=header, comments="")
    report = identify_robot(tmp_path).report
    assert report.headline == "muzzle; assumed: pitch, yaw, sensing, limits, length of the muzzle (0 m)"
    name, angle, length = report.tables[0].rows[1]
    assert (name, angle.unit) == ("muzzle: pellets leave right of the barrel", "°")
    assert angle.low < np.degrees(0.02) < angle.high and re.fullmatch(r"(5\.[89]|6\.[01]) cm at 3 m", length)
    assert "length_m in [muzzle] of logs.toml" in report.next_steps[0]
    (tmp_path / "tape.json").write_text('{"muzzle_length_m": 0.16}')
    assert identify_robot(tmp_path).report.headline == "muzzle; assumed: pitch, yaw, sensing, limits"


def test_python_and_the_command_keep_what_they_did_not_write(tmp_path, refused):
    folder, out = write_axis(tmp_path / "logs" / "yaw_step.csv"), tmp_path / "out"
    out.mkdir()
    (out / "robot.html").write_text("mine")
    refused("robot.html: was not written by this command; .* --overwrite", identify_robot, folder, out=out)
    assert (out / "robot.html").read_text() == "mine"
    found = identify_robot(folder, out=out, overwrite=True)
    assert Robot.load(out).digest() == found.record.digest()
    assert found.report.headline == "yaw; none held back: yaw; assumed: pitch, muzzle, sensing, limits"
    assert len(found.plot().axes[0].lines) == 2


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
    found = identify_robot(one_table, name="mine")
    assert (found.record.name, found.record.assumed) == ("mine", ("muzzle", "sensing", "limits"))
    assert found.record.pitch.dc_gain.item() == pytest.approx(1.0, abs=0.01)
    assert found.record.yaw.dc_gain.item() == pytest.approx(1.0, abs=1e-9)
    unused, *others = found.report.findings
    assert unused.message == 'not used: "Gier.CSV", "timing_sweep.csv"'
    assert "expected names are {pitch,yaw}_{sweep,step}" in unused.remedy
    assert [each.code for each in others] == ["time-duplicate"]  # of both axes, and there once
    steps = found.report.next_steps
    assert "pitch_step_validation.csv" in steps[0]
    assert [each for each in steps if re.search(r"--\w", each) and "archerfish " not in each] == []


def test_timing_logs_may_be_in_degrees_and_in_the_optical_frame(lab_folder, tmp_path):
    usual, other = tmp_path / "usual", tmp_path / "other"
    usual.mkdir()
    other.mkdir()
    (header, *sweep), (names, *plate) = ((lab_folder / f"timing_{each}.csv").read_text().split() for each in FILES)
    stamps, angles = np.hsplit(np.loadtxt(sweep, delimiter=","), [1])
    rows = np.loadtxt(plate, delimiter=",")
    assert names == "time_s,receive_s,x,y,z"
    rows[:, 2:] = np.stack([-rows[:, 3], -rows[:, 4], rows[:, 2]], 1)
    for name, first, table in zip(FILES, (header, names), (np.hstack([stamps, np.degrees(angles)]), rows), strict=True):
        shutil.copyfile(lab_folder / f"timing_{name}.csv", usual / f"timing_{name}.csv")
        np.savetxt(other / f"TIMING_{name}.CSV", table, delimiter=",", header=first, comments="", fmt="%.12g")
    (other / "logs.toml").write_text('[sensing]\nframe = "optical"\ndegrees = true\n')
    known, found = (identify_robot(folder).record.sensing.camera for folder in (usual, other))
    assert found.time_offset == pytest.approx(known.time_offset, abs=1e-6)
    assert found.bearing_sd == pytest.approx(known.bearing_sd, rel=1e-3)


def test_what_sensing_lacks_in_some_rows_or_of_the_target_costs_no_more_than_that(lab_folder, tmp_path):
    for name in ("sweep", "plate", "target"):
        text = (lab_folder / f"timing_{name}.csv").read_text()
        (tmp_path / f"timing_{name}.csv").write_text(text)
    header, *rows = (tmp_path / "timing_plate.csv").read_text().split()
    whole = identify_robot(tmp_path)
    rows[5::50] = [re.sub(r",[^,]*,", ",,", row, count=1) for row in rows[5::50]]  # without receive_s
    (tmp_path / "timing_plate.csv").write_text("\n".join([header, *rows, ""]))
    found = identify_robot(tmp_path)
    camera, expected = found.record.sensing.camera, whole.record.sensing.camera
    assert (camera.latency_basis, found.record.parts["sensing"].usable) == ("feedback", True)
    assert camera.latency == pytest.approx(expected.latency, abs=5e-4)
    assert camera.time_offset == pytest.approx(expected.time_offset, abs=1e-9)
    messages = {finding.code: finding.message for finding in found.report.findings}
    assert messages["unused"] == 'not used: "timing_target.csv"'
    assert messages["missing-values"] == f"detections without receive_s: {len(rows[5::50])}"


def test_a_fault_of_the_program_in_one_part_is_raised_after_the_others_are_written(tmp_path, monkeypatch):
    def failing(*_, **__):
        raise ZeroDivisionError("of ours")

    logs, out = write_axis(tmp_path / "logs" / "yaw_step.csv"), tmp_path / "robot"
    (logs / "shots.csv").write_text("pitch_deg,distance_m\n0,1\n")
    monkeypatch.setattr("archerfish.identification.robot.identify_muzzle", failing)
    with pytest.raises(ZeroDivisionError, match="of ours") as error:
        identify_robot(logs, out=out)
    assert (error.traceback[-1].name, error.value.__notes__) == ("failing", ["while the muzzle was identified"])
    robot = Robot.load(out, accept_unusable=True)
    assert (robot.parts["yaw"].usable, robot.parts["muzzle"].usable) == (True, False)
    assert "archerfish failed with ZeroDivisionError('of ours')" in robot.parts["muzzle"].reasons[0]
    (logs / "yaw_step.csv").unlink()
    with pytest.raises(ZeroDivisionError):
        identify_robot(logs)


def test_a_robot_is_not_written_among_its_logs(one_table, refused):
    before = sorted(one_table.iterdir())
    for out in (one_table / ".", one_table / "robot"):
        refused("is the folder of the logs.*; choose another", identify_robot, one_table, out=out)
    assert sorted(one_table.iterdir()) == before


def test_folders_without_logs_are_refused(tmp_path, refused):
    refused("gone: there is no such folder", identify_robot, tmp_path / "gone")
    (tmp_path / "Gier.CSV").touch()
    refused('expected .*shots.csv.*, found "Gier.CSV"; name the logs so, or in logs.toml', identify_robot, tmp_path)


def test_an_axis_is_identified_by_a_command_next_to_another(tmp_path, capsys):
    log, out = str(write_axis(tmp_path / "steps.csv") / "steps.csv"), str(tmp_path / "out")
    for axis in ("yaw", "pitch"):
        main(["identify", "axis", log, "--validate", log, "--axis", axis, "--out", out])
    assert PlantRecord.load(tmp_path / "out" / "yaw.json").axis == "yaw"
    assert json.loads((tmp_path / "out" / "pitch_report.json").read_text())["usable"]
    assert "pitch: what the logs say" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["identify", "axis", log, "--input", "cmd", "--out", str(tmp_path / "none")])
    assert 'no column "cmd"' in capsys.readouterr().err
    assert not list((tmp_path / "none").glob("*.json"))
