import dataclasses
import inspect
import pickle
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
    later = (
        "import jax\nfrom archerfish2.arrays import single_precision\npart = single_precision(type(part)(1.0, None))\n"
    )
    run_python(f"{BEFORE_JAX}{later}assert jax.jit(lambda each: each)(part).left == 1.0")


def test_a_tree_has_the_signature_of_its_fields_and_goes_through_pickle() -> None:
    assert [*inspect.signature(Part).parameters] == ["left", "right", "count", "name"]
    assert pickle.loads(pickle.dumps(Part(2.0, name="mine"))).name == "mine"


def test_another_name_or_number_compiles_nothing_and_another_static_value_does() -> None:
    jax, traced = pytest.importorskip("jax"), []
    program = jax.jit(lambda part: traced.append(part.name) or part.left * part.count)
    part = single_precision(Part(1.0, name="one"))
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
