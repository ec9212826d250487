import json

import numpy as np
import pytest

from archerfish.paper.gimbal import gate_limits
from archerfish.records.limits import write_limits


def read(path):
    return np.loadtxt(path, delimiter=",", skiprows=1)


def test_it_writes_what_to_play_and_foretells_the_outcome(command, tmp_path):
    status, out, err = command("excite", "--axis", "yaw", "--out", "plan", "--json", "facts.json", "--duration-s", 4)
    assert (status, err) == (0, "")
    names = ["yaw_sweep_command.csv", "yaw_step_command.csv", "yaw_validation_command.csv"]
    assert sorted(path.name for path in (tmp_path / "plan").iterdir()) == sorted(
        [*names, "yaw_excitation.svg", "yaw_excitation.png", ".archerfish.json"]
    )
    facts = json.loads((tmp_path / "facts.json").read_text())
    for name, told in zip(names, facts["commands"], strict=True):
        assert (tmp_path / "plan" / name).read_text().startswith("time_s,u\n0.0,0.0\n0.001,")
        rows = read(tmp_path / "plan" / name)
        np.testing.assert_allclose(np.diff(rows[:, 0]), 1e-3)
        assert len(rows) == told["samples"]
        assert np.abs(np.diff(rows[:, 1], 2)).max() / 1e-6 == pytest.approx(told["acceleration"], rel=1e-6)
    assert facts["commands"][0]["acceleration"] <= facts["limits"]["max_acceleration"]
    assert facts["expected"]["dc_gain"]["half_width_95"] < 0.01
    assert "jump" in out
    assert "DC gain" in out
    assert "--slew-steps" in out.replace("\n", " ")


def test_a_plant_record_is_taken_for_the_prediction_and_a_sweep_alone_wants_a_step(command, records):
    words = ["--plant", "plant.json", "--kinds", "sweep", "--out", "plan", "--high-hz", 20, "--duration-s", 4]
    status, out, _ = command("excite", *words)
    assert status == 0
    assert "as plant.json says" in " ".join(out.split())
    assert "add a step" in " ".join(out.split())
    assert read(records / "plan" / "yaw_sweep_command.csv")[1, 0] == 0.01


def test_limits_may_be_narrowed(command, tmp_path):
    write_limits(tmp_path / "limits.json", gate_limits())
    words = ["--limits", "limits.json", "--max-acceleration", 20, "--no-validation", "--kinds", "sweep"]
    assert command("excite", *words, "--out", "plan", "--duration-s", 4)[0] == 0
    acceleration = np.abs(np.diff(read(tmp_path / "plan" / "yaw_sweep_command.csv")[:, 1], 2)).max() / 1e-6
    assert acceleration == pytest.approx(0.8 * 20, rel=1e-6)


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--axis", "roll"], "--axis must be pitch or yaw"),
        (["--kinds", "noise"], "'noise'"),
        (["--limits", "limits.json", "--max-rate", "99"], "may only narrow"),
        (["--limits", "none.json"], "no such file"),
        (["--plant", "plant.json", "--sample-period-s", "0.001"], "leave the option out"),
        (["--plant", "plant.json"], "high_hz < 50 Hz"),
        (["--amplitude-deg", "80"], "leaves the travel"),
        (["--centre-deg", "90"], "inside the travel"),
        (["--noise-deg", "0"], "noise must be > 0"),
        (["--sample-period-s", "0"], "--sample-period-s must be > 0"),
        (["--damping", "-1"], "damping must be > 0"),
        (["--limit-share", "2"], "share of the limits"),
        (["--high-hz", "700"], "half the sampling rate"),
    ],
)
def test_what_cant_be_planned_is_refused_in_one_line(refused, records, words, told):
    write_limits(records / "limits.json", gate_limits())
    assert told in refused("excite", *words, "--out", "plan")
