"""The claims of docs/errata.md that a computation can settle."""

import importlib
import itertools
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares

from archerfish.identification.muzzle.landing import landing_distance as flat_fire_landing
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_matrix, printed_plants
from archerfish.paper.tables import HitRateRow, hit_rate_table, landing_table
from archerfish.records.plant import PlantRecord, dc_gain

ERRATA = Path(__file__).parents[2] / "docs" / "errata.md"
TRIMMED = (-6, -5, -7, -8)
"""Exponents of B_y where a trailing 7 is taken for the bracket's edge: e-067 → e-06."""
LAST_DIGIT = (-7, -7, -7, -7)
"""Exponents of B_y where the middle digit is dropped: e-067 → e-07."""
LITERAL = (-67, -57, -77, -87)
MANTISSAS = np.array([1.229, 2.354, -1.292, 8.957])


def yaw_with(exponents: tuple[int, ...]) -> PlantRecord:
    matrices = {name: printed_matrix("yaw", name).values for name in ("A", "C")}
    b = (MANTISSAS * 10.0 ** np.array(exponents))[:, None]
    return PlantRecord(**matrices, B=b, D=np.zeros((1, 1)), delay_samples=0, sample_period_s=1e-3)


def step_response(plant: PlantRecord, samples: int) -> np.ndarray:
    state, angles = np.zeros(4), np.zeros(samples)
    for index in range(samples):
        angles[index] = (plant.C @ state).item()
        state = plant.A @ state + plant.B[:, 0]
    return angles


def all_rows(*names: str) -> list[tuple[HitRateRow, int]]:
    return [(row, hit_rate_table(name).shots) for name in names for row in hit_rate_table(name).rows]


def is_whole(percent: float, shots: int) -> bool:
    hits = percent / 100.0 * shots
    return abs(hits - round(hits)) < 1e-6


def test_every_name_of_ours_in_the_errata_exists() -> None:
    names = re.findall(r"`(archerfish(?:\.\w+)+)`", ERRATA.read_text())
    assert names
    for name in names:
        module, _, attribute = name.rpartition(".")
        try:
            importlib.import_module(name)
        except ModuleNotFoundError:
            assert hasattr(importlib.import_module(module), attribute), f"docs/errata.md names {name}"


def test_pitch_has_a_pair_at_9_8_hz_and_one_far_above_the_sweep() -> None:
    plant = printed_plants()["pitch"]
    poles = np.linalg.eigvals(plant.A)
    slow, fast = (pole for pole in sorted(poles, key=abs, reverse=True) if pole.imag > 0)
    assert abs(slow) == pytest.approx(0.969, abs=5e-4)
    assert abs(fast) == pytest.approx(0.927, abs=5e-4)
    continuous = np.log(slow) / plant.sample_period_s
    assert abs(continuous) / (2 * math.pi) == pytest.approx(9.8, abs=0.05)
    assert -continuous.real / abs(continuous) == pytest.approx(0.51, abs=5e-3)
    assert np.angle(fast) / (2 * math.pi) == pytest.approx(0.4, abs=5e-3)


@pytest.mark.parametrize(("exponents", "gain"), [(TRIMMED, -9.6), (LAST_DIGIT, -1.1)])
def test_readings_of_the_yaw_input_differ_in_gain(exponents: tuple[int, ...], gain: float) -> None:
    assert dc_gain(yaw_with(exponents)).item() == pytest.approx(gain, abs=0.05)


def test_once_scaled_the_readings_of_the_yaw_input_hardly_differ() -> None:
    ours = step_response(printed_plants()["yaw"], 2000)
    assert_allclose(step_response(yaw_with(TRIMMED).with_dc_gain(1.0), 2000), ours, atol=1e-12)
    other = step_response(yaw_with(LAST_DIGIT).with_dc_gain(1.0), 2000)
    assert np.max(np.abs(other - ours)) < 0.008
    for response in (ours, other):
        assert np.all(np.diff(response) > 0)
        assert np.argmax(response > 1 - math.exp(-1)) == pytest.approx(137, abs=1)


def test_literal_exponents_of_the_yaw_input_are_impossible() -> None:
    literal = yaw_with(LITERAL)
    assert abs(dc_gain(literal).item()) < 1e-50
    assert step_response(literal.with_dc_gain(1.0), 10).min() < 0


def test_the_fifth_entry_of_the_yaw_input_can_be_none_of_the_four() -> None:
    entries = np.append(MANTISSAS * 10.0 ** np.array(TRIMMED), 0.157)
    gain = printed_matrix("yaw", "C").values @ np.linalg.inv(np.eye(4) - printed_matrix("yaw", "A").values)
    for four in itertools.combinations(range(5), 4):
        if 4 in four:
            assert (gain @ entries[list(four)]).item() > 4e4


def test_a_step_of_10_degrees_asks_more_of_the_yaw_axis_than_its_motor_has() -> None:
    period = 0.02
    moved = step_response(printed_plants()["yaw"], 21)[-1] * math.radians(10.0)
    # Constant acceleration from rest is the least that moves so far in that time.
    needed = 2.0 * moved / period**2
    assert needed == pytest.approx(127, abs=1)
    assert needed > 1.8 * gate_limits().yaw.max_acceleration


def test_the_closed_form_has_lost_the_drag_of_its_vertical_row() -> None:
    # z¨ of eq (5) is −g for any speed; eq (4) demands −g − k v|v|/m there.
    speed, gravity, h = 18.0, 9.81, 1e-4
    height = [speed * t - 0.5 * gravity * t**2 for t in (0.1 - h, 0.1, 0.1 + h)]
    assert (height[0] - 2 * height[1] + height[2]) / h**2 == pytest.approx(-gravity, rel=1e-5)


def test_the_closed_form_solves_the_level_rows_and_fails_for_negative_speeds() -> None:
    k, speed, h = 0.019, 18.0, 1e-4
    at = [math.log(k * speed * t + 1) / k for t in (0.1 - h, 0.1, 0.1 + h)]
    velocity, acceleration = (at[2] - at[0]) / (2 * h), (at[0] - 2 * at[1] + at[2]) / h**2
    assert acceleration == pytest.approx(-k * velocity * abs(velocity), rel=1e-4)
    with pytest.raises(ValueError, match=r"math domain error|expected a positive input"):
        math.log(k * -18.0 * 3.0 + 1)


def landing_distance(pitch: np.ndarray, height: float, speed: float, drag: float = 0.019) -> np.ndarray:
    """Eq (5): fall to the ground by gravity alone, distance with drag."""
    rising = speed * np.sin(pitch)
    time = (rising + np.sqrt(rising**2 + 2 * 9.81 * height)) / 9.81
    return np.log1p(drag * speed * np.cos(pitch) * time) / drag


def with_vertical_drag(pitch: np.ndarray, height: float, speed: float) -> np.ndarray:
    return flat_fire_landing(np.asarray(speed), pitch, height, 0.019)


@pytest.mark.parametrize(
    ("flight", "speed", "worst"),
    [
        (landing_distance, 15.0, 0.12),
        (landing_distance, 25.0, 0.06),
        (with_vertical_drag, 15.0, 0.12),
        (with_vertical_drag, 25.0, 0.07),
    ],
)
def test_table_1_does_not_come_from_a_closed_form(
    flight: Callable[[np.ndarray, float, float], np.ndarray], speed: float, worst: float
) -> None:
    rows = landing_table().rows
    pitch = np.deg2rad([row.pitch_deg for row in rows])
    printed = np.array([row.simulated_m for row in rows])

    def misfit(free: np.ndarray) -> np.ndarray:
        height, offset = free
        return flight(pitch + offset, height, speed) / printed - 1.0

    starts = [(height, math.radians(offset)) for height in (0.1, 0.4) for offset in (-5.0, 0.0)]
    fits = [least_squares(misfit, start, bounds=([1e-6, -0.5], [5.0, 0.5])) for start in starts]
    assert np.max(np.abs(min(fits, key=lambda fit: fit.cost).fun)) == pytest.approx(worst, abs=0.005)


@pytest.mark.parametrize(("flight", "height"), [(landing_distance, 0.228), (with_vertical_drag, 0.224)])
def test_table_1_with_the_printed_angles_fits_no_speed_and_height(
    flight: Callable[[np.ndarray, float, float], np.ndarray], height: float
) -> None:
    rows = landing_table().rows
    pitch = np.deg2rad([row.pitch_deg for row in rows])
    printed = np.array([row.simulated_m for row in rows])
    fit = least_squares(lambda free: flight(pitch, free[0], free[1]) / printed - 1.0, [0.2, 16.0], bounds=(1e-6, 60.0))
    assert fit.x == pytest.approx([height, 15.6], rel=0.01)
    assert np.max(np.abs(fit.fun)) == pytest.approx(0.13, abs=0.005)


def test_two_errors_of_table_1_do_not_follow_from_its_distances() -> None:
    computed = [100 * abs(row.simulated_m - row.real_m) / row.real_m for row in landing_table().rows]
    printed = [row.error_percent for row in landing_table().rows]
    odd = [index for index, pair in enumerate(zip(computed, printed, strict=True)) if abs(pair[0] - pair[1]) > 0.0055]
    assert odd == [2, 6]
    assert computed[2] == pytest.approx(1.652, abs=1e-3)
    assert computed[6] == pytest.approx(0.102, abs=1e-3)


def test_no_kalman_rate_is_a_count_of_the_stated_shots() -> None:
    rows = all_rows("II", "III", "IV", "V")
    assert len(rows) == 16
    assert not any(is_whole(row.kalman_percent, shots) for row, shots in rows)


def test_all_kalman_rates_are_counts_of_5000_shots() -> None:
    assert all(is_whole(row.kalman_percent, 5000) for row, _ in all_rows("II", "III", "IV", "V"))


def test_every_ppo_rate_is_a_count_of_the_stated_shots() -> None:
    assert all(is_whole(row.ppo_percent, shots) for row, shots in all_rows("II", "III", "IV", "V"))


def test_fifty_shots_leave_nearly_thirteen_points_either_way() -> None:
    assert 1.96 * math.sqrt(0.7 * 0.3 / 50) == pytest.approx(0.127, abs=5e-4)


def test_the_paper_loses_to_kalman_in_all_of_table_4_and_nowhere_else() -> None:
    assert all(row.ppo_percent < row.kalman_percent for row, _ in all_rows("IV"))
    assert all(row.ppo_percent > row.kalman_percent for row, _ in all_rows("II", "III", "V"))


def test_most_differences_on_the_robot_are_within_noise() -> None:
    # Two rates of 50 shots each, at 70 %: 95 % of differences by chance alone are below 18 points.
    differences = [abs(row.ppo_percent - row.kalman_percent) for row, _ in all_rows("IV", "V")]
    assert max(differences) < 100 * 1.96 * math.sqrt(2 * 0.7 * 0.3 / 50)


def test_in_simulation_the_paper_hits_moving_targets_better_than_still_ones() -> None:
    still, moving = hit_rate_table("II").rows, hit_rate_table("III").rows
    assert all(m.ppo_percent > s.ppo_percent for s, m in zip(still, moving, strict=True))


def test_the_parabola_never_falls_below_its_vertex() -> None:
    conditions = assumed_conditions()
    lateral = np.linspace(-conditions.reversal_half_width, conditions.reversal_half_width, 101)
    forward = conditions.parabola_curvature * lateral**2
    assert forward.min() == 0.0
    assert forward.max() == pytest.approx(conditions.parabola_rise)


def test_dispersion_alone_leaves_no_flat_hit_rates() -> None:
    # A round spread of σ hits a disc of radius r at distance d with probability 1 − exp(−r²/(2 (σ d)²)).
    distance = np.array([1.5, 2.5, 3.5, 4.5])
    sigma = assumed_conditions().hit_radius / (4.5 * math.sqrt(-2 * math.log(1 - 0.7846)))
    rates = 1 - np.exp(-(assumed_conditions().hit_radius ** 2) / (2 * (sigma * distance) ** 2))
    assert rates[-1] == pytest.approx(0.7846)
    assert rates[0] > 0.999  # where Table II prints 80.22 %
