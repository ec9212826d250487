"""The tables of docs/bounds.md are those of the bounds that come with the library."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

from archerfish.evaluation.bounds.published import read_published

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("bounds_tables", ROOT / "benchmarks" / "bounds_tables.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_of_the_page_are_those_of_the_library(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "bounds.md").read_text()
    assert tables.rendered(page, read_published()) == page


def test_a_changed_figure_would_show(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "bounds.md").read_text()
    cell = read_published()[-1].cells[0]
    assert f"{100 * cell.reach:.2f}" in page
    changed = page.replace(f"{100 * cell.reach:.2f}", "12.34")
    assert tables.rendered(changed, read_published()) == page
