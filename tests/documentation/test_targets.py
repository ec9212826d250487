"""The tables of docs/targets.md are those of the library."""

from types import ModuleType

import pytest

from .benchmark_module import ROOT, benchmark_module


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return benchmark_module("targets_table")


def test_the_tables_of_the_page_are_those_of_the_library(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "targets.md").read_text()
    assert tables.rendered(page) == page, "run python benchmarks/targets_table.py"


def test_a_changed_figure_would_show(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "targets.md").read_text()
    assert "0.08 to 0.6 m" in page
    assert tables.rendered(page.replace("0.08 to 0.6 m", "0.08 to 0.7 m")) == page
