"""The tables of docs/bounds.md are those of the bounds that come with the library."""

from types import ModuleType

import pytest

from archerfish.evaluation.bounds.published import read_published

from .benchmark_module import ROOT, benchmark_module


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    return benchmark_module("bounds_tables")


def test_the_tables_of_the_page_are_those_of_the_library(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "bounds.md").read_text()
    assert tables.rendered(page, read_published()) == page


def test_a_changed_figure_would_show(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "bounds.md").read_text()
    cell = read_published()[-1].cells[0]
    assert f"{100 * cell.reach:.2f}" in page
    changed = page.replace(f"{100 * cell.reach:.2f}", "12.34")
    assert tables.rendered(changed, read_published()) == page
