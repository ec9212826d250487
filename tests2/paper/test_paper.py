import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from archerfish2.errors import InputError
from archerfish2.paper.conditions import assumed_conditions, calibration, paper_muzzle, paper_tuning
from archerfish2.paper.gimbal import gate_limits, printed_matrix, printed_plants
from archerfish2.paper.tables import hit_rate_table, landing_table, printed_rate

TABLES = ("II", "III", "IV", "V")
ROWS = [(row, hit_rate_table(name).shots) for name in TABLES for row in hit_rate_table(name).rows]


def test_conditions_are_in_radians_and_agree_with_the_tables_and_the_parabola() -> None:
    conditions, muzzle = assumed_conditions(), paper_muzzle()
    assert conditions.range_bins == tuple(row.range_m for row in hit_rate_table("II").rows)
    assert conditions.dispersion == muzzle.pitch_sd == muzzle.yaw_sd == pytest.approx(math.radians(0.2))
    assert conditions.line_of_sight_lead == pytest.approx(math.radians(2.0))
    assert (muzzle.speed, muzzle.drag, muzzle.yaw_offset, muzzle.length) == (18.0, 0.019, 0.0, 0.0)
    assert conditions.reversal_half_width == pytest.approx(0.115, abs=5e-4)
    widest = math.atan2(conditions.max_lateral_offset + conditions.reversal_half_width, conditions.range_bins[0][0])
    assert widest < gate_limits().yaw.high


def test_the_residuals_of_the_calibration_are_ours_less_the_tables() -> None:
    found = calibration()
    for table, range_m, ours, residual in found.cells:
        assert residual == pytest.approx(ours - printed_rate(table, range_m, "kalman-paper"), abs=0.01)
    assert math.sqrt(np.mean([each[3] ** 2 for each in found.cells])) == pytest.approx(found.rmse_points, abs=0.05)


@pytest.mark.parametrize(("axis", "gain", "natural_hz"), [("pitch", 1.0310, 9.8), ("yaw", 1.0, None)])
def test_the_plants_have_the_stated_gain_period_and_dominant_pair(axis: str, gain: float, natural_hz: float) -> None:
    plant = printed_plants()[axis]
    poles = np.linalg.eigvals(plant.A)
    assert np.all(np.abs(poles) < 1.0)
    assert plant.dc_gain.item() == pytest.approx(gain, abs=5e-5)
    assert (plant.axis, plant.sample_period_s, plant.delay_samples, plant.A.shape) == (axis, 1e-3, 0, (4, 4))
    if natural_hz:
        slowest = np.log(max(poles, key=abs)) / plant.sample_period_s
        assert abs(slowest) / (2 * math.pi) == pytest.approx(natural_hz, abs=0.05)
        assert -slowest.real / abs(slowest) == pytest.approx(0.51, abs=5e-3)


@pytest.mark.parametrize("axis", ["pitch", "yaw"])
@pytest.mark.parametrize("name", ["A", "B", "C"])
def test_clear_matrices_are_used_as_printed_and_the_damaged_one_is_scaled(axis: str, name: str) -> None:
    matrix, used = printed_matrix(axis, name), getattr(printed_plants()[axis], name)
    if matrix.legibility == "clear":
        assert_array_equal(matrix.values, [[float(entry.replace(" ", "")) for entry in row] for row in matrix.printed])
        assert_array_equal(used, matrix.values)
    else:
        assert (axis, name) == ("yaw", "B")
        mantissas = [float(entry.split("e")[0]) for (entry,) in matrix.printed[:4]]
        assert_allclose(matrix.values[:, 0] / 10.0 ** np.floor(np.log10(np.abs(matrix.values[:, 0]))), mantissas)
        assert_allclose(used / matrix.values, np.full((4, 1), 1 / -9.641017), rtol=1e-6)


def test_limits_are_the_printed_ranges_and_what_the_motor_can_accelerate() -> None:
    limits = gate_limits()
    ranges = [limits.pitch.low, limits.pitch.high, limits.yaw.low, limits.yaw.high]
    assert_allclose(np.rad2deg(ranges), [-25, 10, -75, 75])
    # 1.2 N m over the axis' inertia, rounded.
    assert (limits.yaw.max_acceleration, limits.pitch.max_acceleration) == (round(1.2 / 0.018), round(1.2 / 0.0094))


def test_kalman_rates_are_counts_of_5000_shots_and_never_of_the_stated_ones() -> None:
    def is_count(percent: float, shots: int) -> bool:
        return abs(percent / 100 * shots - round(percent / 100 * shots)) < 1e-6

    assert len(ROWS) == 16
    assert not any(is_count(row.kalman_percent, shots) for row, shots in ROWS)
    assert all(is_count(row.kalman_percent, 5000) and is_count(row.ppo_percent, shots) for row, shots in ROWS)


def test_table_1_has_two_errors_that_do_not_follow_from_its_distances() -> None:
    rows = landing_table().rows
    misfits = [abs(100 * abs(row.simulated_m / row.real_m - 1) - row.error_percent) for row in rows]
    assert [index for index, misfit in enumerate(misfits) if misfit > 0.0055] == [2, 6]
    assert max(row.error_percent for row in rows) < landing_table().claimed_error_percent


def test_printed_rates_belong_to_policies_and_to_the_filter_of_the_paper_s_conditions() -> None:
    assert printed_rate("II", (1, 2), "kalman-paper") == 80.22
    assert printed_rate("III", (4.0, 5.0), "mine", is_policy=True) == 87.65
    for table, range_m, controller in (
        ("II", (1, 2), "kalman"),
        ("II", (1, 2), "mine"),
        ("II", (1, 3), "kalman-paper"),
    ):
        assert printed_rate(table, range_m, controller) is None
    for table in ("I", "VI"):
        with pytest.raises(InputError, match=f"got '{table}'"):
            printed_rate(table, (1, 2), "kalman-paper")


@pytest.mark.parametrize("limit", ["gate", "box", "los-2deg"])
def test_each_limit_has_tuned_settings_and_those_of_the_calibrated_filter(limit: str) -> None:
    found = paper_tuning(limit)
    assert found.keys() == {"kalman-paper", "kalman", "kalman-lq", "imm-lq", "parabola-lq"}
    assert found["kalman-paper"] == {"acceleration_sd": 30.0, "extra_lead_s": 0.04}
    assert found["kalman"]["acceleration_sd"] >= 64.0
