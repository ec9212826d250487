"""The tables of docs/targets.md are those of the library."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def tables() -> ModuleType:
    spec = importlib.util.spec_from_file_location("targets_table", ROOT / "benchmarks" / "targets_table.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_of_the_page_are_those_of_the_library(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "targets.md").read_text()
    assert tables.rendered(page) == page, "run python benchmarks/targets_table.py"


def test_a_changed_figure_would_show(tables: ModuleType) -> None:
    page = (ROOT / "docs" / "targets.md").read_text()
    assert "0.08 to 0.6 m" in page
    assert tables.rendered(page.replace("0.08 to 0.6 m", "0.08 to 0.7 m")) == page
