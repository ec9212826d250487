import numpy as np
import pytest

from archerfish.figures.shots import ShotGroups, shots_figure

GROUPS = ShotGroups(
    np.array([0, 0, 0, 1, 1]),
    ("0° pitch", "5° pitch"),
    np.array([2.9, 3.1, 1.0, 6.3, 6.1]),
    np.array([3.0, 3.0, 3.0, 6.2, 6.2]),
    np.array([0.1, 0.1, 0.1, 0.2, 0.2]),
    np.array([True, True, False, True, True]),
)


def test_every_setting_has_a_bar_of_two_standard_deviations_around_the_model():
    where, residual = shots_figure(GROUPS).axes
    np.testing.assert_allclose([bar.get_y() for bar in where.patches], [2.8, 5.8])
    np.testing.assert_allclose([bar.get_height() for bar in where.patches], [0.4, 0.8])
    np.testing.assert_allclose([bar.get_height() for bar in residual.patches], [40, 80])
    assert [label.get_text() for label in where.get_xticklabels()] == ["0° pitch", "5° pitch"]


def test_shots_are_dots_and_outliers_crosses_that_stay_in_the_picture():
    where, residual = shots_figure(GROUPS).axes
    dots, crosses = residual.lines[-2:]
    np.testing.assert_allclose(dots.get_ydata(), [-10, 10, 10, -10])
    assert crosses.get_ydata()[0] == residual.get_ylim()[0]
    assert where.lines[-1].get_ydata()[0] == 1.0


def test_the_bar_of_shots_with_measured_speeds_holds_the_spread_of_their_means():
    moved = GROUPS._replace(expected=np.array([2.9, 3.1, 3.0, 6.2, 6.2]))
    half = 2 * np.sqrt(0.01 + np.var([2.9, 3.1, 3.0]))
    assert shots_figure(moved).axes[0].patches[0].get_height() == pytest.approx(2 * half)


def test_many_settings_share_the_labels():
    count = 40
    groups = ShotGroups(np.arange(count), [f"{i}°" for i in range(count)], *np.ones((3, count)), np.ones(count, bool))
    assert len(shots_figure(groups).axes[0].get_xticks()) <= 12
