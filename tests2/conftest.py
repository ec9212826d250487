"""Settings of JAX and of the linear algebra for every process of a run, and the fixtures that all tests share."""

import copy
import functools
import hashlib
import importlib.metadata
import importlib.util
import json
import os
import platform
import random
import shutil
import subprocess
import sys
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]


def kept_programs() -> dict[str, str]:
    """Settings of JAX's cache, one for each processor and version; none where JAX is missing."""
    if importlib.util.find_spec("jaxlib") is None:
        return {}
    facts = Path("/proc/cpuinfo")
    lines = facts.read_text(errors="replace").splitlines() if facts.is_file() else [platform.processor()]
    flags = sorted({each for each in lines if each.startswith(("model name", "flags", "Features"))})
    processor = hashlib.sha256("\n".join([platform.machine(), *flags]).encode()).hexdigest()[:12]
    settings = {
        "JAX_COMPILATION_CACHE_DIR": str(ROOT / ".venv" / f"jax-{importlib.metadata.version('jaxlib')}-{processor}"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.2",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    }
    if importlib.util.find_spec("filelock") is not None:  # JAX locks its writes only where the size is limited
        settings["JAX_COMPILATION_CACHE_MAX_SIZE"] = "2000000000"
    return settings


# Before the first import of JAX; workers and the processes that tests start share them.
os.environ.update(
    kept_programs(),
    JAX_NUM_CPU_DEVICES="2",  # a training takes a device for each of its shards
    JAX_NUMPY_RANK_PROMOTION="raise",  # a silent broadcast of (3,) against (2, 3) is how batch dimensions get mixed up
    TF_CPP_MIN_LOG_LEVEL="3",  # on some processors XLA prints a page about every kept program (openxla/xla issue 44565)
    COLUMNS="110",  # tables are printed for the terminal
    OMP_NUM_THREADS="1",
    OPENBLAS_NUM_THREADS="1",
    MKL_NUM_THREADS="1",
)


@pytest.fixture(params=[(), (3,), (2, 3)], ids=str)
def batch(request: pytest.FixtureRequest) -> tuple[int, ...]:
    """Batch shape B; formulas hold at each."""
    return request.param


@pytest.fixture(scope="session")
def shared() -> Path:
    """Folder of recorded logs and references, which lies beside the repository and is not part of it."""
    folder = ROOT.parent / "shared"
    if not folder.is_dir():
        pytest.skip("needs the folder ../shared, beside the repository")
    return folder


@pytest.fixture(scope="session")
def reference(shared: Path) -> Path:
    """Folder of the first edition's records, logs and policies."""
    return shared / "second_edition" / "reference"


@pytest.fixture(scope="session")
def made_once(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, Callable[[Path], object]], Path]:
    """Make something expensive once per run, by function(folder), and return its folder in every worker.

    Tests read the folder; one that writes takes a copy.
    """
    base = tmp_path_factory.getbasetemp()
    place = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def make(name: str, function: Callable[[Path], object]) -> Path:
        from filelock import FileLock

        folder, done = place / name, place / f"{name}.done"
        with FileLock(place / f"{name}.lock"):
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)  # of a worker that failed halfway
                folder.mkdir()
                function(folder)
                done.touch()
        return folder

    return make


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
def agree(quick_jit: Callable[..., Any]) -> Callable[..., Any]:
    """Check that a function of trees gives in JAX, compiled and in float32, what it gives in NumPy; return the latter.

    Call it as agree(function, *arguments, rtol=…, atol=…); what is no array goes into the function by a partial.
    """
    import jax

    from archerfish2.arrays import register, single_precision

    def check(function: Callable[..., Any], *arguments: Any, rtol: float = 1e-5, atol: float = 1e-6) -> Any:
        register()
        arguments = single_precision(arguments)
        expected = function(*arguments)
        found = jax.tree_util.tree_leaves_with_path(quick_jit(function)(*arguments))
        for ours, (path, theirs) in zip(jax.tree.leaves(expected), found, strict=True):
            where = jax.tree_util.keystr(path)
            assert ours.shape == theirs.shape, where
            assert ours.dtype.kind == theirs.dtype.kind, where
            assert ours.dtype != np.float64, where
            np.testing.assert_allclose(theirs, ours, rtol=rtol, atol=atol, err_msg=where)
        return expected

    return check


@pytest.fixture(scope="session")
def conformance() -> Any:
    """Return the module of the conformance world, with `build` and `engagements`."""
    spec = importlib.util.spec_from_file_location("conformance_world", ROOT / "tests2" / "conformance" / "world.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def run_python() -> Callable[..., str]:
    """Run Python in a process of its own, where the modules named by `blocked` can't be imported; return its output."""

    def run(code: str, *, blocked: tuple[str, ...] = (), timeout_s: float = 120.0, **environment: str) -> str:
        code = f"import sys\nsys.modules.update(dict.fromkeys({blocked!r}))\n{code}"
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **environment}
        words = [sys.executable, "-c", code]
        done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=timeout_s, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


NAN, HUGE = float("nan"), 10**400
ODD: Any = [None, True, "1", -1, 0, 1, 2.5, 1e308, -1e13, HUGE, NAN, [], {}, [[[1.0]]], "\ud800\n", [1.0] * 1000]
STRANGE = (b"", b"[]", b"1", b"null", b"\x00" * 1000, b"[" * 50_000, b'{"a":' * 50_000, b'{"schema":[' * 50_000)


def _places(content: Any) -> list[tuple[Any, Any]]:
    keys: Any = list(content) if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    return [(content, key) for key in keys] + [place for key in keys for place in _places(content[key])]


def _mutated(content: bytes, draw: random.Random) -> bytes:
    kind = draw.choice(("cut", "flip", "strange", "retype", "retype", "scale", "scale", "scale", "remove", "double"))
    if kind == "strange":
        return draw.choice((*STRANGE, content * 2))
    if kind in ("cut", "flip"):
        changed = bytearray(content)
        changed[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        return bytes(changed if kind == "flip" else changed[: draw.randrange(len(content))])
    root = json.loads(content)
    for _ in range(draw.choice((1, 1, 2, 5))):
        places = _places(root)
        numbers = [place for place in places if kind == "scale" and type(place[0][place[1]]) is float]
        parent, key = draw.choice(numbers or places or [([0.0], 0)])
        parent[key] = parent[key] * draw.choice((-1, 0, 0.999, 2, 1e9)) if numbers else copy.deepcopy(draw.choice(ODD))
        if kind == "remove":
            del parent[key]
    text = json.dumps(root)
    return (text[:-1] + "," + text[1:] if kind == "double" else text).encode()


@pytest.fixture(scope="session")
def mutations() -> Callable[[bytes, int, int], list[bytes]]:
    """Make mutated contents of a JSON file: mutations(content, count, seed)."""
    return lambda content, count, seed: [_mutated(content, random.Random(f"{seed} {each}")) for each in range(count)]


@pytest.fixture(scope="session")
def accepted() -> Callable[[Callable[[], Any]], Any]:
    """Check that a reader refuses a file in one line, or returns something, within a second and 200 MB; return that."""

    def check(read: Callable[[], Any]) -> Any:
        from archerfish2.errors import InputError

        tracemalloc.start()
        started, result = time.process_time(), None
        try:
            result = read()
        except InputError as error:
            assert "\n" not in str(error)
        spent = time.process_time() - started, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert (spent[0] < 1.0, spent[1] < 200e6) == (True, True)
        return result

    return check
