"""Settings of JAX and of the linear algebra for every process of a run, and the fixtures that all tests share."""

import contextlib
import copy
import functools
import json
import os
import random
import re
import runpy
import shutil
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from archerfish import compiled
from archerfish.arrays import register, single_precision
from archerfish.errors import InputError

ROOT = Path(__file__).parents[1]


with pytest.MonkeyPatch.context() as patch:
    patch.setenv("ARCHERFISH_CACHE", str(ROOT / ".venv"))
    KEPT = str(compiled._programs_folder()) if compiled.has_jax() else ""

# Before the first import of JAX; workers and the processes that tests start share them.
os.environ.update(
    JAX_COMPILATION_CACHE_DIR=KEPT,
    JAX_COMPILATION_CACHE_MAX_SIZE="2000000000",  # JAX locks its writes only where the size is limited
    JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS="0.2",
    JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES="-1",
    # Compiling costs a test more than running: with few optimisations a training compiles in two fifths of the time.
    # One thread as in the processes of a study, which then find the programs that were compiled here.
    XLA_FLAGS="--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
    JAX_NUM_CPU_DEVICES="2",  # a training takes a device for each of its shards
    JAX_NUMPY_RANK_PROMOTION="raise",  # a silent broadcast of (3,) against (2, 3) is how batch dimensions get mixed up
    TF_CPP_MIN_LOG_LEVEL="3",  # on some processors XLA prints a page about every kept program (openxla/xla issue 44565)
    COLUMNS="110",  # tables are printed for the terminal
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
)


@pytest.fixture(scope="session")
def has_units():
    """Return a function that draws all figures of a report, and finds a unit in brackets in each label of an axis."""

    def check(report, count):
        panels = [panel for _, draw in report.figures for panel in draw().axes if panel.get_visible()]
        labels = {text for panel in panels for text in (panel.get_xlabel(), panel.get_ylabel()) if text}
        assert [text for text in labels if not re.search(r"\[[^]]+\]", text)] == []
        assert len(report.figures) == count <= len(panels)

    return check


@pytest.fixture(params=[(), (3,), (2, 3)], ids=str)
def batch(request):
    """Batch shape B; formulas hold at each."""
    return request.param


@pytest.fixture(scope="session")
def quick_jit():
    """Compile as jax.jit does, but with few optimisations: compiling costs a test far more than running."""
    few = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}
    options = {**few, "xla_cpu_use_fusion_emitters": False}
    return functools.partial(pytest.importorskip("jax").jit, compiler_options=options)


@pytest.fixture(scope="session")
def agree(quick_jit):
    """Check that a function of trees gives in JAX, compiled and in float32, what it gives in NumPy; return the latter.

    Call it as agree(function, *arguments, rtol=…, atol=…); what is no array goes into the function by a partial.
    """
    import jax

    def check(function, *arguments, rtol=1e-5, atol=1e-6):
        register()
        arguments = single_precision(arguments)
        expected = function(*arguments)
        found = jax.tree_util.tree_leaves_with_path(quick_jit(function)(*arguments))
        for ours, (path, theirs) in zip(jax.tree.leaves(expected), found, strict=True):
            assert (theirs.shape, theirs.dtype.kind) == (ours.shape, ours.dtype.kind), path
            assert ours.dtype != np.float64, path
            np.testing.assert_allclose(theirs, ours, rtol=rtol, atol=atol, err_msg=jax.tree_util.keystr(path))
        return expected

    return check


@pytest.fixture(scope="session")
def conformance():
    """Return the conformance world's module, with `build` and `engagements`."""
    return SimpleNamespace(**runpy.run_path(str(ROOT / "tests" / "conformance" / "world.py")))


@pytest.fixture(scope="session")
def run_python():
    """Run Python in a process of its own, where the modules named by `blocked` can't be imported; return its output."""

    def run(code, *, blocked=(), timeout_s=120.0, **environment):
        code = f"import sys\nsys.modules.update(dict.fromkeys({blocked!r}))\n{code}"
        environment = {**os.environ, "PYTHONPATH": str(ROOT / "src"), **environment}
        return subprocess.check_output([sys.executable, "-c", code], text=True, env=environment, timeout=timeout_s)

    return run


@pytest.fixture(scope="session")
def refused():
    """Check that a call is refused in one line; return the error: refused(pattern, function, *arguments, **named)."""

    def check(pattern, call, *arguments, **named):
        with pytest.raises(InputError, match=pattern) as error:
            call(*arguments, **named)
        assert "\n" not in str(error.value)
        return error.value

    return check


@pytest.fixture(scope="session")
def shared():
    """Return a path in the folder `shared` beside the clone; where it is not there, the test is skipped."""

    def path(place):
        found = (each / "shared" / place for each in ROOT.parents)
        return next(filter(Path.exists, found), None) or pytest.skip(f"no shared/{place} beside the clone")

    return path


LAB = "second_edition/reference/infantry_logs"


@pytest.fixture(scope="session")
def lab_folder(tmp_path_factory, shared):
    """Return a copy of the folder of logs of a robot: sweeps, steps, shots and timing."""
    place = tmp_path_factory.mktemp("lab") / "logs"
    copied = Path(shutil.copytree(shared(LAB), place, copy_function=shutil.copyfile))
    for each in (copied, *filter(Path.is_dir, copied.rglob("*"))):
        each.chmod(0o755)  # the original may be read-only
    limits = copied / "limits.json"  # whose fields are the same, as version 0.1 wrote it
    limits.write_text(limits.read_text().replace("archerfish.limits/1", "archerfish.limits/2"))
    return copied


NAN, HUGE = float("nan"), 10**400
ODD = [None, True, "1", -1, 0, 1, 2.5, 1e308, -1e13, HUGE, NAN, [], {}, [[[1.0]]], "\ud800\n", [1.0] * 1000]
STRANGE = (b"", b"[]", b"1", b"null", b"\x00" * 1000, b"[" * 50_000, b'{"a":' * 50_000, b'{"schema":[' * 50_000)


def _places(content):
    keys = list(content) if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    return [(content, key) for key in keys] + [place for key in keys for place in _places(content[key])]


def _mutated(content, draw):
    kind = draw.choice(("cut", "flip", "strange", "retype", "retype", "scale", "scale", "scale", "remove", "double"))
    if kind in ("cut", "flip", "strange"):
        cut, rest = content[: (place := draw.randrange(len(content)))], content[place + 1 :]
        flipped = cut + bytes([content[place] ^ 1 << draw.randrange(8)]) + rest
        return {"cut": cut, "flip": flipped, "strange": draw.choice((*STRANGE, content * 2))}[kind]
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


FIELDS = 'nan - 1e400 1e308 1e-320 -0 " 0x1 1_0 1,5 # , ; \n \0 999 \u06f3'.encode().split(b" ")


def _damaged(content, draw):
    """Change bytes of a file that is not JSON, or what stands between its commas or line ends."""
    first, length = draw.randrange(len(content)), draw.choice((1, 1, 4, 100, 10**6))
    if draw.random() < 0.6:
        changed = draw.choice((b"", draw.randbytes(length), bytes(length), b"\xff" * length))[:1000]
        return content[:first] + changed + content[first + length :]
    pieces = content.split(mark := draw.choice((b",", b"\n")))
    place = draw.randrange(len(pieces))
    taken = pieces[place : place + draw.choice((1, 1, 3, 20))]
    pieces[place : place + len(taken)] = draw.choice(([], 2 * taken, [draw.choice(FIELDS)]))
    return mark.join(pieces)


def _toml(table, place=""):
    lines = [f"{name} = {json.dumps(value)}" for name, value in table.items() if not isinstance(value, dict)]
    for name, value in table.items():
        if isinstance(value, dict):
            lines += [f"[{place}{name}]", _toml(value, f"{place}{name}.")]
    return "\n".join(lines)


def _as_toml(content):
    """Write the tables of a JSON object as TOML; what is no object stays as it is, and some are cut."""
    with contextlib.suppress(ValueError, AttributeError, RecursionError):
        content = _toml(json.loads(content)).encode("utf-8", "surrogatepass")
    return content[: len(content) - len(content) % 3 * 7]


@pytest.fixture(params=[1, pytest.param(7, marks=pytest.mark.slow)])
def mutated(request):
    """Read a file mutated `count` times, and yield what is read; the rest is refused in one line.

    Each within a second and 200 MB, or the limits `most`. Call it as mutated(path, read, count, seed=…, convert=…), the
    latter of contents; a file whose name ends with .toml has JSON at first, and is read as TOML.
    """

    def run(path, read, count, seed=0, convert=None, most=(1.0, 200e6)):
        original, convert = path.read_bytes(), convert or (_as_toml if path.suffix == ".toml" else bytes)
        for number in range(count * request.param):
            change = _mutated if original[:1] == b"{" else _damaged
            path.write_bytes(convert(change(original, random.Random(f"{seed} {number}"))))
            tracemalloc.start()
            started, result = time.process_time(), None
            try:
                result = read()
            except InputError as error:
                assert "\n" not in str(error)
            spent, peak = time.process_time() - started, tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
            assert (spent < most[0], peak < most[1]) == (True, True)
            if result is not None:
                yield result

    return run
