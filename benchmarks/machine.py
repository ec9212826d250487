"""How fast this machine is: the yardstick beside every time that a benchmark reports."""

import os
import platform
import time
from typing import Any

import numpy as np

from archerfish.records.provenance import code_commit, library_versions

SIZE = 1024
"""Order of the matrices: large enough to be bound by arithmetic, small enough for any cache and memory."""
ROUNDS = 7


def matrix_product_rate(size: int = SIZE) -> float:
    """Return the rate of float32 matrix products of NumPy, the best of a few rounds [GFLOP/s].

    Args:
      size: order of the matrices.
    """
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal((2, size, size), dtype=np.float32)
    out = np.empty_like(left)
    np.matmul(left, right, out=out)  # the first product starts the threads
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        np.matmul(left, right, out=out)
        times.append(time.perf_counter() - start)
    # The best: whatever else runs on the machine only ever adds time.
    return 2.0 * size**3 / min(times) / 1e9


def describe_machine() -> dict[str, Any]:
    """Return what a benchmark writes beside its results: processor, cores, matrix-product rate, commit and versions."""
    return {
        "machine": platform.machine(),
        "system": platform.system(),
        "cores": len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count(),
        "matrix_product_gflops": round(matrix_product_rate(), 1),
        "commit": code_commit(),
        "versions": library_versions(),
    }
