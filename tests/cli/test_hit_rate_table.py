import io

from rich.console import Console

from archerfish.cli.hit_rate_table import print_hit_rates
from archerfish.evaluation.results import Cell


def cell(setting: str, limit: str, hits: int) -> Cell:
    where = {"table": "IV", "setting": setting, "target": "static", "range_m": (1.0, 2.0), "command_limit": limit}
    misses = {"misses_slewing": 0, "misses_settled": 100 - hits}
    low, high = hits / 100 - 0.01, hits / 100 + 0.01
    return Cell(**where, controller="kalman", policy_seed=None, hits=hits, shots=100, engagements=2, low=low, high=high,
                **misses)  # fmt: skip


def test_every_world_and_command_limit_has_a_table_of_its_own() -> None:
    console = Console(file=io.StringIO(), width=80)
    cells = [cell("identified-infantry", "gate", 81), cell("infantry", "gate", 72), cell("infantry", "box", 93)]
    print_hit_rates(cells, console)
    tables = console.file.getvalue().split("hit rate in %")[1:]
    assert len(tables) == 3
    for table, name, rate in zip(
        tables,
        ("identified-infantry, command limit gate", "infantry, command limit gate", "infantry, command limit box"),
        ("81.0", "72.0", "93.0"),
        strict=True,
    ):
        assert name in " ".join(table.split())
        assert rate in table
