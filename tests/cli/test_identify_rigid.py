import json

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from archerfish.records.rigid_axis import read_rigid_axis

INERTIA, DAMPING = 0.02, 0.05


@pytest.fixture
def yaw_log(tmp_path):
    """Log of a damped wheel under a sweep of torque: time, current (0.5 N m/A) and angle."""
    time = np.arange(500) * 0.02
    torque = 0.3 * np.sin(2 * np.pi * (0.3 * time + 0.13 * time**2))
    top, bottom, _ = cont2discrete(([1.0], [INERTIA, DAMPING, 0.0]), 0.02)
    angle = lfilter(top.ravel(), bottom, torque) + 1e-3 * np.random.default_rng(0).standard_normal(500)
    path = tmp_path / "yaw.csv"
    rows = np.column_stack([time, torque / 0.5, angle, np.degrees(angle)])
    np.savetxt(path, rows, delimiter=",", header="time_s,current,angle,angle_deg", comments="", fmt="%.9g")
    return path


def test_it_writes_record_picture_and_summary(command, yaw_log, tmp_path):
    words = [yaw_log, "--torque", "current", "--torque-per-unit", 0.5, "--axis", "yaw", "--out", "out"]
    status, out, err = command("identify", "rigid", *words, "--json", "facts.json", "--seed", 4)
    assert (status, err) == (0, "")
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        ".archerfish.json",
        "yaw_rigid.json",
        "yaw_rigid.svg",
        "yaw_rigid.png",
    }
    record = read_rigid_axis(tmp_path / "out" / "yaw_rigid.json")
    assert (record.axis_kind, record.provenance["seed"]) == ("yaw", 4)
    assert set(record.provenance["inputs"]) == {"yaw.csv"}
    assert record.inertia == pytest.approx(INERTIA, rel=0.01)
    assert record.damping == pytest.approx(DAMPING, rel=0.01)
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert facts["parameters"]["inertia"] == record.inertia
    assert facts["fits"][0]["fit_percent"] > 99
    assert "inertia m l²" in out


def test_friction_is_told_with_its_interval_when_asked_for(command, yaw_log, tmp_path):
    words = [yaw_log, "--torque", "current", "--torque-per-unit", 0.5, "--friction", "coulomb", "--out", "out"]
    status, out, _ = command("identify", "rigid", *words, "--json", "facts.json")
    assert status == 0
    assert "Coulomb friction" in out
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert set(facts["intervals_95"]) == {"inertia", "damping", "torque_offset", "friction"}
    assert facts["units"]["friction"] == "N m"
    assert facts["parameters"]["friction"] < 0.003


def test_a_column_in_degrees_is_turned_into_radians_and_said_so(command, yaw_log, tmp_path):
    words = [yaw_log, "--torque", "current", "--torque-per-unit", 0.5, "--angle", "angle_deg", "--out", "out"]
    _, out, _ = command("identify", "rigid", *words)
    assert read_rigid_axis(tmp_path / "out" / "axis_rigid.json").inertia == pytest.approx(INERTIA, rel=0.01)
    assert "turned into radians" in " ".join(out.split())


def test_a_log_with_a_gap_becomes_two_recordings(command, yaw_log, tmp_path):
    lines = yaw_log.read_text().splitlines()
    (tmp_path / "gap.csv").write_text("\n".join([*lines[:250], *lines[280:]]) + "\n")
    words = ["gap.csv", "--torque", "current", "--torque-per-unit", 0.5, "--out", "out"]
    status, out, _ = command("identify", "rigid", *words, "--json", "facts.json")
    assert status == 0
    assert len(json.loads((tmp_path / "facts.json").read_text())["fits"]) == 2
    assert "1 gap" in " ".join(out.split())


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "no log given"),
        (["none.csv"], "none.csv: no such file"),
        (["yaw.csv"], '"torque"'),
        (["yaw.csv", "--torque", "current", "--torque-per-unit", "-1"], "negative --torque-per-unit"),
        (["yaw.csv", "--torque", "current", "--torque-per-unit", "0"], "not 0"),
        (["yaw.csv", "--torque", "current", "--axis-kind", "roll"], "'roll'"),
        (["yaw.csv", "--torque", "current", "--axis", "a/b"], "--axis names files"),
        (["yaw.csv", "--torque", "current", "--sample-period-s", "0"], "--sample-period-s"),
    ],
)
def test_what_cant_be_used_is_refused_in_one_line(refused, yaw_log, words, told):
    assert told in refused("identify", "rigid", *words, "--out", "out")
