import numpy as np
import pytest

jax = pytest.importorskip("jax")

from archerfish.simulation.packing import pack, packing_of, unpack  # noqa: E402

TREE = {
    "place": np.arange(6, dtype=np.float32).reshape(2, 3),
    "count": np.array([2**31 - 1, -5], np.int32),
    "flags": np.array([True, False]),
    "speed": np.float32(0.5),
    "none": np.zeros((0, 4), np.float32),
}


@pytest.mark.parametrize("compiled", [False, True])
def test_a_tree_comes_back_bit_for_bit(compiled: bool) -> None:
    again = jax.jit(unpack, static_argnums=0) if compiled else unpack
    found = again(packing_of(TREE), *pack(TREE))
    for name, array in TREE.items():
        assert found[name].dtype == array.dtype
        assert np.array_equal(found[name], array)


def test_a_tree_of_floats_alone_has_no_integers() -> None:
    floats, integers = pack({"speed": np.float32(0.5)})
    assert floats.shape == (1,)
    assert integers.shape == (0,)


def test_trees_of_the_same_shapes_compile_once() -> None:
    other = {name: array + array for name, array in TREE.items()}
    assert hash(packing_of(TREE)) == hash(packing_of(other))
    assert packing_of(TREE) == packing_of(other)
