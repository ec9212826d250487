"""A steady gain that the logs contradict is told, with both numbers."""

import json

import numpy as np
import pytest

from archerfish.identification.axis.state_space import simulate
from archerfish.records.plant import PlantRecord, read_plant
from archerfish.records.plant import dc_gain as steady_gain
from archerfish.records.recording import make_recording, write_recording_csv

PERIOD = 0.01
A, C = np.array([[0.9, 0.2], [-0.2, 0.9]]), np.array([[1.0, 0.5]])
PLANT = PlantRecord(A, np.array([[0.1], [0.2]]), C, np.zeros((1, 1)), 1, PERIOD).with_dc_gain(1.0)


@pytest.fixture
def step_log(tmp_path):
    """Steps that are held until the axis rests, with 1 % noise."""
    rng = np.random.default_rng(0)
    inputs = np.repeat(rng.standard_normal(12), 100)[:, None]
    outputs = simulate(PLANT, inputs)
    outputs += 0.01 * outputs.std() * rng.standard_normal(outputs.shape)
    write_recording_csv(tmp_path / "steps.csv", make_recording(inputs, outputs, PERIOD))
    return "steps.csv"


def told(command, tmp_path, log, gain):
    words = ["identify", "gimbal", log, "--order", "2", "--axis", "yaw", "--out", "out", "--json", "facts.json"]
    status, out, err = command(*words, "--dc-gain", gain)
    assert (status, err) == (0, "")
    page = " ".join((tmp_path / "out" / "yaw.html").read_text().split())
    return json.loads((tmp_path / "facts.json").read_text()), " ".join(out.split()), page


@pytest.mark.parametrize("gain", [57.3, 1.2, -1.0])
def test_a_gain_that_the_logs_contradict_is_told_with_both_numbers(command, tmp_path, step_log, gain):
    facts, out, page = told(command, tmp_path, step_log, gain)
    (held,) = facts["held_gains"]
    low, high = held["estimated_interval"]
    assert held["contradicted"]
    assert held["input"] == "u"
    assert held["asked"] == pytest.approx(gain, abs=1e-3)
    # True is 1; that an interval of 95 % misses it by more than its own width would be strange.
    assert 2 * low - high < 1.0 < 2 * high - low
    assert held["estimated"] == pytest.approx(1.0, abs=0.02)
    assert f"--dc-gain {gain:.4g} contradicts the logs, which say" in facts["headline"]
    for words in (out, page):
        assert f"--dc-gain {gain:.4g} for u contradicts the logs: left free, the steady gain is" in words
        assert "leave --dc-gain out" in words
    assert page.index('class="warning"') < page.index("What is known")
    assert steady_gain(read_plant(tmp_path / "out" / "yaw.json")).item() == pytest.approx(gain, abs=1e-3)


def test_a_gain_that_the_logs_agree_with_is_told_as_held(command, tmp_path, step_log):
    facts, out, page = told(command, tmp_path, step_log, 1.0)
    assert not facts["held_gains"][0]["contradicted"]
    assert "contradicts" not in out + page
    assert "was held to 1 (--dc-gain), not estimated; left free, the logs say" in page
    assert "the logs alone say" in page


def test_without_a_given_gain_nothing_is_held(command, tmp_path, step_log):
    status, _, _ = command("identify", "gimbal", step_log, "--order", "2", "--out", "out", "--json", "facts.json")
    assert status == 0
    assert json.loads((tmp_path / "facts.json").read_text())["held_gains"] == []
