import importlib
import math
import re
from pathlib import Path

import numpy as np
import pytest

import archerfish
from archerfish.paper.conditions import assumed_conditions, calibration, paper_muzzle, paper_tuning
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.paper.tables import hit_rate_table, landing_table, printed_rate


def test_conditions_are_in_radians_and_agree_with_the_tables_and_the_parabola():
    conditions, muzzle = assumed_conditions(), paper_muzzle()
    assert conditions.range_bins == tuple(row.range_m for row in hit_rate_table("II").rows)
    assert conditions.dispersion == muzzle.pitch_sd == muzzle.yaw_sd == pytest.approx(math.radians(0.2))
    half_width = math.sqrt(conditions.parabola_rise / conditions.parabola_curvature)
    assert half_width == pytest.approx(0.115, abs=5e-4)
    widest = math.atan2(conditions.max_lateral_offset + half_width, conditions.range_bins[0][0])
    assert widest < gate_limits().yaw.high == pytest.approx(math.radians(75))
    assert gate_limits().yaw.max_acceleration == round(1.2 / 0.018)  # 1.2 N m over the axis' inertia
    for found in (paper_tuning(each) for each in ("gate", "box", "los-2deg")):
        assert found.keys() == {"kalman-paper", "kalman", "kalman-lq", "imm-lq", "parabola-lq"}
        assert found["kalman-paper"] == {"acceleration_sd": 30.0, "extra_lead_s": 0.04}


def test_the_residuals_of_the_calibration_are_ours_less_the_tables():
    found = calibration()
    for table, range_m, ours, residual in found.cells:
        assert residual == pytest.approx(ours - printed_rate(table, range_m, "kalman-paper"), abs=0.01)
    assert math.sqrt(np.mean([each[3] ** 2 for each in found.cells])) == pytest.approx(found.rmse_points, abs=0.05)


def test_the_plants_have_the_stated_gains_and_pitch_its_dominant_pair():
    plants = printed_plants()
    assert [plant.dc_gain.item() for plant in plants.values()] == pytest.approx([1.0310, 1.0], abs=5e-5)
    slowest = np.log(max(np.linalg.eigvals(plants["pitch"].A), key=abs)) / plants["pitch"].sample_period_s
    assert abs(slowest) / (2 * math.pi) == pytest.approx(9.8, abs=0.05)
    assert -slowest.real / abs(slowest) == pytest.approx(0.51, abs=5e-3)


def test_rates_are_compared_with_those_of_policies_and_of_the_filter_with_the_paper_s_conditions(refused):
    assert (len(landing_table().rows), printed_rate("II", (1, 2), "kalman-paper")) == (9, 80.22)
    assert printed_rate("III", (4.0, 5.0), "mine", is_policy=True) == 87.65
    assert printed_rate("II", (1, 2), "kalman") is printed_rate("II", (1, 3), "kalman-paper") is None
    refused("expected table II, III, IV or V, got 'I'", printed_rate, "I", (1, 2), "kalman-paper")


def test_each_equation_of_the_paper_is_found_in_the_source_by_its_number():
    source = "".join(path.read_text().lower() for path in Path(archerfish.__file__).parent.rglob("*.py"))
    assert [number for number in range(1, 17) if f"eq ({number})" not in source] == []


def test_the_map_of_the_paper_has_each_equation_table_and_figure_and_names_what_there_is():
    page = Path(__file__).parents[2].joinpath("docs", "paper.md").read_text()
    labels = re.findall(r"(?m)^\| (?:Eq|Table|Figs?\.?) ([^ ]+) \|", page.partition("## What the paper")[0])
    expected = [*(f"({number})" for number in range(1, 17)), *["I", "II", "III", "IV", "V"], "1–3", *"456"]
    assert labels == expected
    for name in re.findall(r"`archerfish\.([\w.]+)`", page):
        module, _, function = name.rpartition(".")
        assert callable(getattr(importlib.import_module(f"archerfish.{module}"), function))
