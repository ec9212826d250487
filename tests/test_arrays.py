"""Trees of arrays, and where compiled programs are kept."""

import dataclasses
import inspect
import pickle
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish import compiled
from archerfish.arrays import leaves, map_arrays, single_precision, tree


@tree(static=("count",), left_out=("name",))
class Part:
    left: Any
    right: Any = None
    count: int = 1
    name: str = ""


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


CODE = "from archerfish.compiled import import_jax\nprint(import_jax().config.jax_compilation_cache_dir)"


def test_programs_are_kept_in_the_folder_that_is_named_or_in_that_of_jax(run_python, tmp_path):
    names = {"ARCHERFISH_CACHE": str(tmp_path), "JAX_COMPILATION_CACHE_DIR": ""}
    assert Path(run_python(CODE, **names).strip()).relative_to(tmp_path).parts[0] == "jax"
    assert run_python(CODE, **names | {"JAX_COMPILATION_CACHE_DIR": "/own"}) == "/own\n"


def test_the_cache_is_the_users_unless_it_is_off_and_without_jax_the_error_says_what_to_install(monkeypatch, refused):
    monkeypatch.delenv("ARCHERFISH_CACHE", raising=False)
    assert compiled.cache_folder("jax").parts[-2:] == ("archerfish", "jax")
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    assert compiled.cache_folder("jax") is None
    monkeypatch.setitem(sys.modules, "jax", None)
    refused("pip install", compiled.import_jax)
