"""Policies with random weights, as records on the disk, and what an exported one is held against."""

import importlib.util
import itertools
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.controllers.network import Layer, Normaliser
from archerfish.controllers.policy import TRACKING, PolicyController, policy_to_record
from archerfish.dynamics.array_namespace import single_precision
from archerfish.dynamics.muzzle import Muzzle
from archerfish.records.policy import write_policy
from archerfish.sensing.kalman_filter import TrackerNoise
from archerfish.sensing.observation import make_observer
from archerfish.sensing.observers import AnyObserver

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
MUZZLE = Muzzle(*(np.asarray(each) for each in (18.0, 0.2, (0.01, -0.002), (0.0035, 0.0035), 0.019, 0.16)))


def random_policy(kind: str) -> PolicyController:
    """A policy with random weights, as lively as a trained one."""
    rng, braking = np.random.default_rng(1), np.array([0.02, 0.04])
    observer: AnyObserver
    if kind in TRACKING:
        noise = TrackerNoise(*(np.asarray(each) for each in (3.0, 1e-3, 1e-3, 0.015, 0.0017)))
        observer = TRACKING[kind](MUZZLE, noise, 0.02, (0.03, 0.1), braking)
    else:
        observer = make_observer(kind, MUZZLE, action_scale=(0.03, 0.1), braking=braking)
    sizes = (observer.size, 32, 2)
    layers = tuple(
        Layer(rng.standard_normal(pair) / np.sqrt(pair[0]), 0.1 * rng.standard_normal(pair[1]))
        for pair in itertools.pairwise(sizes)
    )
    normaliser = Normaliser(0.1 * rng.standard_normal(sizes[0]), 0.01 + rng.random(sizes[0]), np.asarray(1.0))
    policy: PolicyController = single_precision(PolicyController(observer, normaliser, layers))
    return policy


@pytest.fixture
def policy_file(tmp_path: Path) -> Callable[[str], Path]:
    """Write the record of a policy of a kind."""

    def write(kind: str) -> Path:
        path = tmp_path / "policy.json"
        ramp = {"pitch_gain": 1.03, "yaw_gain": 1.0, "lead": 0.06} if kind == "multimodel" else {}
        facts = {"period_s": 0.02, "command_limit": "gate", "training": {"seed": 1}, "ramp": ramp}
        record = policy_to_record(random_policy(kind), **facts)
        write_policy(path, record)
        return path

    return write


def load_benchmark(name: str) -> Any:
    """Import a module of the benchmarks, which are no package."""
    spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def inputs() -> Any:
    """Frames, lively and at the edges."""
    return load_benchmark("export_inputs")


@pytest.fixture(scope="session")
def agreement() -> Any:
    """Runs one policy in NumPy, JAX and ONNX Runtime."""
    for needed in ("jax", "onnx", "onnxruntime"):
        pytest.importorskip(needed)
    return load_benchmark("export_agreement")
