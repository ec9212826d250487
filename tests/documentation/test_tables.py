import importlib.util
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
BENCHMARKS = ROOT / "benchmarks"


@pytest.fixture(scope="module")
def tables():
    """The module that writes the tables, which is in no package."""
    sys.path.insert(0, str(BENCHMARKS))
    try:
        spec = importlib.util.spec_from_file_location("tables", BENCHMARKS / "tables.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        yield module
    finally:
        sys.path.remove(str(BENCHMARKS))


def test_every_table_of_hit_rates_is_that_of_the_committed_results(tables) -> None:
    results = tables.committed()
    for name in tables.PAGES:
        page = (ROOT / name).read_text()
        assert tables.rendered(page, results) == page, f"{name}: run python benchmarks/tables.py"


def test_no_marked_table_stands_in_a_page_that_is_not_written(tables) -> None:
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    marked = {str(each.relative_to(ROOT)) for each in pages if "<!-- table " in each.read_text()}
    assert marked <= set(tables.PAGES)


def test_the_code_still_makes_the_counts_of_the_committed_results(tables) -> None:
    assert tables.probe() == tables.committed()["reproduce"]["probe"]
