import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish.paper.gimbal import gate_limits, printed_matrix, printed_plants
from archerfish.paper.legibility import Legibility
from archerfish.records.limits import read_limits, write_limits
from archerfish.records.plant import dc_gain, read_plant, write_plant


@pytest.mark.parametrize(("axis", "gain"), [("pitch", 1.0310), ("yaw", 1.0)])
def test_the_plants_have_the_stated_dc_gain(axis: str, gain: float) -> None:
    assert dc_gain(printed_plants()[axis]).item() == pytest.approx(gain, abs=5e-5)


@pytest.mark.parametrize("axis", ["pitch", "yaw"])
def test_the_plants_are_stable_single_axes_sampled_at_1_khz(axis: str) -> None:
    plant = printed_plants()[axis]
    assert np.all(np.abs(np.linalg.eigvals(plant.A)) < 1.0)
    assert (plant.axis, plant.sample_period_s, plant.delay_samples) == (axis, 1e-3, 0)
    assert (plant.A.shape, plant.B.shape, plant.C.shape, plant.D.item()) == ((4, 4), (4, 1), (1, 4), 0.0)


@pytest.mark.parametrize("axis", ["pitch", "yaw"])
@pytest.mark.parametrize("name", ["A", "B", "C"])
def test_clear_matrices_are_used_as_printed(axis: str, name: str) -> None:
    matrix = printed_matrix(axis, name)
    if matrix.legibility is Legibility.CLEAR:
        assert_array_equal(matrix.values, [[float(entry.replace(" ", "")) for entry in row] for row in matrix.printed])
        assert_array_equal(getattr(printed_plants()[axis], name), matrix.values)
    else:
        assert (axis, name) == ("yaw", "B")
        assert matrix.note


def test_the_damaged_yaw_input_keeps_the_printed_mantissas() -> None:
    matrix = printed_matrix("yaw", "B")
    mantissas = [float(entry.split("e")[0]) for (entry,) in matrix.printed[:4]]
    read = matrix.values[:, 0]
    assert_allclose(read / 10.0 ** np.floor(np.log10(np.abs(read))), mantissas)
    assert_allclose(printed_plants()["yaw"].B / matrix.values, np.full((4, 1), 1 / -9.641017), rtol=1e-6)


def test_plants_survive_a_round_trip_through_their_files(tmp_path) -> None:
    for axis, plant in printed_plants().items():
        write_plant(tmp_path / f"{axis}.json", plant)
        again = read_plant(tmp_path / f"{axis}.json")
        assert_array_equal(again.A, plant.A)
        assert_array_equal(again.B, plant.B)
        assert again.provenance == plant.provenance


def test_limits_are_the_printed_ranges_and_what_the_motor_can_accelerate(tmp_path) -> None:
    limits = gate_limits()
    assert_allclose(
        np.rad2deg([limits.pitch.low, limits.pitch.high, limits.yaw.low, limits.yaw.high]), [-25, 10, -75, 75]
    )
    # 1.2 N m over the axis' inertia, rounded.
    assert limits.yaw.max_acceleration == round(1.2 / 0.018) == 67
    assert limits.pitch.max_acceleration == round(1.2 / 0.0094) == 128
    write_limits(tmp_path / "limits.json", limits)
    assert read_limits(tmp_path / "limits.json") == limits


def test_the_pitch_step_overshoots_and_settles_as_its_dominant_pair_says() -> None:
    plant = printed_plants()["pitch"]
    state, angles = np.zeros(4), []
    for _ in range(400):
        angles.append((plant.C @ state).item())
        state = plant.A @ state + plant.B[:, 0]
    # A second-order pair of damping ζ overshoots by exp(−π ζ / √(1 − ζ²)).
    damping = 0.509
    assert max(angles) / angles[-1] - 1.0 == pytest.approx(
        math.exp(-math.pi * damping / math.sqrt(1 - damping**2)), abs=0.01
    )
