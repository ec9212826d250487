"""docs/paper_map.md: complete, and every function and test that it names exists."""

import ast
import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in (ROOT / "docs" / "paper_map.md").read_text().splitlines()
    if line.startswith("|") and not line.startswith("|---")
]
NAMED = re.compile(r"`([^`]+)`")
NOT_APPLICABLE = {"1", "2", "3"}
"""Figures that show no result: a photograph, a sketch, a flow chart."""


def column(index: int) -> list[str]:
    """Return the names in code style of one column of all tables, each once."""
    return sorted({name for row in ROWS for name in NAMED.findall(row[index])} - {"archerfish identify"})


def test_every_equation_table_and_figure_has_one_row() -> None:
    labels = [row[0] for row in ROWS]
    equations = [f"({number})" for number in range(1, 17)]
    assert labels == ["Eq", *equations, "Table", "I", "II", "III", "IV", "V", "Figure", *"123456"]


def test_every_row_names_a_function_and_a_test_or_says_why_not() -> None:
    for label, _, functions, tests in (row for row in ROWS if row[0] not in {"Eq", "Table", "Figure"}):
        if label in NOT_APPLICABLE:
            assert functions.startswith("not applicable")
        else:
            assert NAMED.findall(functions), label
            assert NAMED.findall(tests), label


@pytest.mark.parametrize("name", column(2))
def test_named_functions_can_be_imported(name: str) -> None:
    module, _, function = name.rpartition(".")
    if module.startswith(("archerfish.learning", "archerfish.cli")):
        pytest.importorskip("jax")
    assert callable(getattr(importlib.import_module(module), function))


@pytest.mark.parametrize("name", column(3))
def test_named_tests_exist(name: str) -> None:
    path, _, test = name.partition("::")
    module = ast.parse((ROOT / path).read_text())
    assert test.startswith("test_")
    assert test in {node.name for node in module.body if isinstance(node, ast.FunctionDef)}
