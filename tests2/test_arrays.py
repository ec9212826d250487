import dataclasses
from typing import Any

import numpy as np
import pytest

from archerfish2.arrays import leaves, map_arrays, single_precision, tree


@tree(static=("count",), left_out=("name",))
class Part:
    left: Any
    right: Any = None
    count: int = 1
    name: str = ""


BEFORE_JAX = """
import numpy as np
from archerfish2.arrays import map_arrays, tree
part = tree()(type("Part", (), {"__annotations__": {"left": object, "right": object}}))(np.ones(2), None)
assert map_arrays(lambda each: 2.0 * each, part).left.tolist() == [2.0, 2.0]
"""


def test_trees_work_without_jax_and_with_it_when_it_comes_later(run_python) -> None:
    run_python(BEFORE_JAX, blocked=("jax",))
    run_python(BEFORE_JAX + "import jax\nassert jax.jit(lambda each: each)(type(part)(1.0, None)).left == 1.0")


def test_another_name_or_number_compiles_nothing_and_another_static_value_does() -> None:
    jax, traced = pytest.importorskip("jax"), []
    program = jax.jit(lambda part: traced.append(part.name) or part.left * part.count)
    part = Part(np.float32(1.0), name="one")
    for changes in ({}, {"name": "two"}, {"left": np.float32(2.0)}, {"count": 3}):
        assert program(dataclasses.replace(part, **changes)) == changes.get("left", 1.0) * changes.get("count", 1)
    assert traced == ["", ""]


def test_none_is_skipped_and_the_rest_of_a_part_is_that_of_the_first() -> None:
    nested = Part(np.ones(2), count=3, name="mine"), (np.zeros(1), np.arange(3))
    double = single_precision(map_arrays(np.add, nested, nested))
    assert (double[0].right, double[0].count, double[0].name) == (None, 3, "mine")
    assert [(each.dtype.kind, each.sum()) for each in leaves(double)] == [("f", 4.0), ("f", 0.0), ("i", 6)]
    with pytest.raises(ValueError, match="None in one"):
        map_arrays(np.add, Part(np.ones(2)), Part(np.ones(2), np.ones(2)))
    with pytest.raises(TypeError, match="name must be fields, with a default if left out"):
        tree(left_out=("name",))(type("Bad", (), {"__annotations__": {"name": str}}))
