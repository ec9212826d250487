"""What the comparison of trainings prints."""

from collections.abc import Mapping
from typing import Any

from rich.table import Table


def rates_table(tools: Mapping[str, Mapping[str, Any]]) -> Table:
    """Show each tool's speed, and how long it took to the paper's hit rates."""
    columns = ("steps/s", "ours ×", "cold compile s", "warm s", "s to the paper", "steps to it", "peak MiB")
    table = Table("tool", *columns, title="training, learning included and compilation excluded")
    for name, each in tools.items():
        if each.get("problem"):
            table.add_row(name, f"not run: {each['problem']}")
            continue
        table.add_row(
            name,
            f"{each['steps_per_second']:,}",
            _number(each["ours_over_it"]),
            _number(each["compile_seconds_cold"]),
            _number(each["compile_seconds_warm"]),
            _number(each["seconds_to_bar"]),
            _number(each["steps_to_bar"]),
            f"{each['peak_mib']:,.0f}",
        )
    return table


def growth_table(title: str, unit: str, growth: Mapping[str, Mapping[str, float | None]]) -> Table:
    """Show how each tool's steps per second grow with a setting."""
    settings = list(next(iter(growth.values()), {}))
    table = Table(unit, *settings, title=f"{title}: steps per second")
    for name, rates in growth.items():
        table.add_row(name, *("—" if rate is None else f"{rate:,.0f}" for rate in rates.values()))
    return table


def figures_table(figures: Mapping[str, Any]) -> Table:
    """Show single numbers."""
    table = Table("figure", "value", title="environment, evaluation and the machine")
    for name, value in figures.items():
        table.add_row(name, _number(value))
    return table


def targets_table(targets: Mapping[str, tuple[float, float]]) -> Table:
    """Show what was to be reached, and what was."""
    table = Table("target", "at least", "reached", "", title="targets")
    for name, (least, reached) in targets.items():
        table.add_row(name, _number(least), _number(reached), "yes" if reached >= least else "[red]no[/red]")
    return table


def _number(value: float | None) -> str:
    if value is None:
        return "—"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"
