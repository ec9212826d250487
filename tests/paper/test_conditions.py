import dataclasses
import math

import pytest

from archerfish.paper.conditions import Calibration, assumed_conditions, calibration, calibration_from
from archerfish.paper.tables import hit_rate_table


def test_an_engagement_has_fifty_decisions() -> None:
    assert assumed_conditions().decisions == 50


def test_the_target_turns_back_where_the_parabola_has_risen_by_4_cm() -> None:
    conditions = assumed_conditions()
    half_width = conditions.reversal_half_width
    assert conditions.parabola_curvature * half_width**2 == pytest.approx(0.04)
    assert half_width == pytest.approx(0.115, abs=5e-4)


def test_degrees_in_the_file_become_radians() -> None:
    conditions = assumed_conditions()
    assert conditions.dispersion == pytest.approx(math.radians(0.2))
    assert conditions.line_of_sight_lead == pytest.approx(math.radians(2.0))


def test_the_bins_are_the_ranges_of_the_tables() -> None:
    assert assumed_conditions().range_bins == tuple(row.range_m for row in hit_rate_table("II").rows)


def test_every_vertex_is_within_the_yaw_range() -> None:
    conditions = assumed_conditions()
    reach = conditions.max_lateral_offset + conditions.reversal_half_width
    assert math.atan2(reach, conditions.range_bins[0][0]) < math.radians(75)


def test_calibration_is_read_with_its_cells() -> None:
    cell = {"table": "II", "range_m": [1, 2], "ours_percent": 79.0, "residual_points": -1.22}
    facts = {
        "cells": [cell],
        "rmse_points": 2.5,
        "engagements": 3000,
        "sets_tried": 100,
        "sets_within_3_points": 7,
        "note": "",
    }
    read = calibration_from(facts)
    assert read.cells[0].range_m == (1.0, 2.0)
    assert {field.name for field in dataclasses.fields(Calibration)} == facts.keys()


def test_the_residuals_in_the_file_agree_with_the_tables() -> None:
    found = calibration()
    for cell in found.cells if found else ():
        printed = {row.range_m: row.kalman_percent for row in hit_rate_table(cell.table).rows}[cell.range_m]
        assert cell.residual_points == pytest.approx(cell.ours_percent - printed, abs=0.01)
