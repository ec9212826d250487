import atexit
import functools
import importlib.util
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.cli.compilation_cache import SHORTEST_S, load_quietly
from archerfish.dynamics.array_namespace import single_precision

# Tests leave nothing in the user's folders, and compile what they test, but each program once: workers and the
# commands they start share what they have compiled in this run.
os.environ["ARCHERFISH_CACHE"] = "off"
if "PYTEST_XDIST_WORKER" not in os.environ:
    shared = tempfile.mkdtemp(prefix="archerfish-tests-")
    atexit.register(shutil.rmtree, shared, ignore_errors=True)
    os.environ["JAX_COMPILATION_CACHE_DIR"] = shared
    os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = SHORTEST_S
    os.environ["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"

try:
    import jax
except ImportError:  # the robot's installation has no JAX; the tests that need it import it themselves
    pass
else:
    load_quietly()
    # A silent broadcast of shape (3,) against (2, 3) is how batch dimensions get mixed up.
    jax.config.update("jax_numpy_rank_promotion", "raise")
    # A training takes a device for each of its shards, if it comes before everything else that computes.
    jax.config.update("jax_num_cpu_devices", 2)

SHARED_DATA = Path(__file__).parents[1] / ".." / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of recorded logs, which lies beside the repository and is not part of it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("needs the recorded logs in ../shared/data, beside the repository")
    return SHARED_DATA.resolve()


@pytest.fixture(scope="session")
def sensing_recordings() -> Any:
    """Simulator of sensing recordings with known truth, which a benchmark uses too."""
    path = Path(__file__).parents[1] / "benchmarks" / "sensing_recordings.py"
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def quick_jit() -> Callable[..., Any]:
    """Compile as jax.jit does, but with few optimisations: compiling costs a test far more than running."""
    jax = pytest.importorskip("jax")
    options = {
        "xla_backend_optimization_level": 0,
        "xla_llvm_disable_expensive_passes": True,
        "xla_cpu_use_fusion_emitters": False,
    }
    return functools.partial(jax.jit, compiler_options=options)


@pytest.fixture(scope="session")
def agree_in_jax(quick_jit: Callable[..., Any]) -> Callable[..., Any]:
    """Check that a function gives in JAX, compiled and in float32, what it gives in NumPy; return NumPy's result."""

    def check(function: Callable[..., Any], *arguments: Any, rtol: float = 1e-5, atol: float = 1e-6) -> Any:
        arguments = single_precision(arguments)
        expected = function(*arguments)
        found = quick_jit(function)(*arguments)
        for ours, theirs in zip(jax.tree.leaves(expected), jax.tree.leaves(found), strict=True):
            assert ours.shape == theirs.shape
            assert ours.dtype.kind == theirs.dtype.kind
            assert ours.dtype != np.float64
            np.testing.assert_allclose(theirs, ours, rtol=rtol, atol=atol)
        return expected

    return check
