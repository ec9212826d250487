import numpy as np
import pytest

from archerfish.cli.identification_stage import AxisTask, identify_logged, landing_of_table1
from archerfish.paper.tables import landing_table
from archerfish.records.plant import PlantRecord, read_plant
from archerfish.records.recording import read_recording_csv

# An axis at 10 Hz with damping 0.5, sampled at 250 Hz so that its logs are short.
ANGLE, RADIUS = 2 * np.pi * 10 * 0.004 * np.sqrt(0.75), np.exp(-2 * np.pi * 10 * 0.004 * 0.5)
AXIS = PlantRecord(
    A=RADIUS * np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]]),
    B=np.array([[0.2], [0.1]]),
    C=np.array([[1.0, 0.3]]),
    D=np.zeros((1, 1)),
    delay_samples=0,
    sample_period_s=0.004,
).with_dc_gain(1.0)


def test_an_axis_is_logged_and_found_from_its_logs_alone(tmp_path):
    facts, response = identify_logged(AxisTask("pitch", AXIS, tmp_path, (5, 0)))
    assert response.fit_percent > 99.0
    assert facts["dc_gain"] == pytest.approx(1.0, abs=0.01)
    assert facts["validation"] == [{"file": "validation.csv", "fit_percent": pytest.approx(99.0, abs=0.3)}]
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {
        "logs/pitch/sweep.csv",
        "logs/pitch/step.csv",
        "logs/pitch/validation.csv",
        "plants/pitch.json",
        "plants/pitch.safetensors",
        "figures/fig4_pitch.svg",
        "figures/fig4_pitch.png",
    }
    plant = read_plant(tmp_path / "plants" / "pitch.json")
    assert plant.provenance["seed"] == 5
    assert set(plant.provenance["inputs"]) == {"sweep.csv", "step.csv", "validation.csv"}


def test_the_log_has_the_stated_noise(tmp_path):
    identify_logged(AxisTask("pitch", AXIS, tmp_path, (0, 0)))
    path = tmp_path / "logs" / "pitch" / "validation.csv"
    recording = read_recording_csv(path, "time_s", ("u",), ("y",))
    settled = recording.outputs[recording.time > 1.0, 0]
    # The step is twice 5° down; the noise is 1 % of the standard deviation of the whole clean log.
    assert settled.mean() == pytest.approx(-np.deg2rad(10.0), rel=1e-3)
    assert settled.std() == pytest.approx(0.01 * recording.outputs.std(), rel=0.25)


def test_table_1_keeps_the_printed_rows_and_states_its_lack_of_fit():
    table, printed = landing_of_table1(), landing_table().rows
    assert [(row.alpha_deg, row.beta_deg, row.d1_m, row.d2_m) for row in table.rows] == [
        (row.pitch_deg, row.yaw_deg, row.simulated_m, row.real_m) for row in printed
    ]
    errors = np.array([row.model_m / row.d2_m - 1 for row in table.rows])
    assert table.lack_of_fit.rms_percent == pytest.approx(100 * np.sqrt(np.mean(errors**2)))
    assert table.lack_of_fit.worst_percent == pytest.approx(100 * np.abs(errors).max())
    assert table.lack_of_fit.statement
