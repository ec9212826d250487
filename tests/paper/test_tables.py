import csv
from pathlib import Path

import pytest

from archerfish.paper.tables import HitRateTable, hit_rate_table, landing_table, printed_rate, printed_table
from archerfish.records.errors import InputError

RANGES = ((1.0, 2.0), (2.0, 3.0), (3.0, 4.0), (4.0, 5.0))


@pytest.mark.parametrize("name", ["II", "III", "IV", "V"])
def test_hit_rate_tables_have_a_row_for_every_range(name: str) -> None:
    table = hit_rate_table(name)
    assert tuple(row.range_m for row in table.rows) == RANGES
    assert all(50.0 < rate < 100.0 for row in table.rows for rate in (row.ppo_percent, row.kalman_percent))
    assert table.target == ("static" if name in ("II", "IV") else "dynamic")
    assert (table.environment, table.shots) == (("simulation", 2000) if name in ("II", "III") else ("real", 50))


def test_the_landing_table_is_that_of_the_data_set(shared_data: Path) -> None:
    with (shared_data / "robomaster" / "paper_table1_landing.csv").open() as file:
        recorded = [tuple(float(value) for value in row.values()) for row in csv.DictReader(file)]
    assert [(row.pitch_deg, row.yaw_deg, row.simulated_m, row.real_m) for row in landing_table().rows] == recorded


def test_the_printed_errors_of_table_1_keep_to_the_claim_of_the_text() -> None:
    table = landing_table()
    assert max(row.error_percent for row in table.rows) < table.claimed_error_percent == 5


def test_any_table_is_found_by_its_numeral() -> None:
    assert printed_table("I") == landing_table()
    assert isinstance(printed_table("V"), HitRateTable)


@pytest.mark.parametrize(
    ("table", "range_m", "controller", "rate"),
    [
        ("II", (1, 2), "kalman", 80.22),
        ("II", (4, 5), "history", 84.55),
        ("III", (1, 2), "paper", 88.35),
        ("III", (4.0, 5.0), "kalman", 68.84),
        ("IV", (4, 5), "history", 66.00),
        ("V", (4, 5), "kalman", 60.56),
        ("II", (1, 2), "oracle", None),
        ("II", (5, 6), "kalman", None),
    ],
)
def test_printed_rates_stand_beside_our_controllers(table, range_m, controller, rate) -> None:
    assert printed_rate(table, range_m, controller) == rate


@pytest.mark.parametrize("name", ["I", "VI", "2"])
def test_an_unknown_table_is_refused_by_name(name: str) -> None:
    with pytest.raises(InputError, match=f"got '{name}'"):
        hit_rate_table(name)
