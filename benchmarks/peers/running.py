"""Run a tool on a case and score what it found, the same way for all of them."""

import json
import os
import subprocess
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from archerfish.identification.validation.free_run import free_run
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import make_recording
from identification_cases import Array, Case, Log
from peers import environments
from peers.environments import NotRunError
from peers.roster import Tool

ORDER = 4
UNSTABLE = 1.001
"""A pole of larger modulus makes a model unstable; a free run then says nothing."""
FIT_LIMIT_S = 600
SURROUNDINGS = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "JAX_PLATFORMS": "cpu",
    # JAX compiles anew for every fit; with its cache on, only the first fit in a process pays for that.
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
    "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
    "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1",
}


class Score(NamedTuple):
    """One tool, in one setting, on one case."""

    case: str
    """Name of the case."""
    tool: str
    """Name of the tool."""
    setting: str
    """The setting that is reported."""
    variant: str = ""
    """Which of the setting's variants was taken, by its training fit."""
    test_fit_percent: float | None = None
    """Fit of the test part in free run [%]; None if the model is unstable or there is none."""
    training_fit_percent: float | None = None
    """Fit of the training part in free run [%]."""
    largest_pole: float | None = None
    """Largest modulus of a pole."""
    delay_samples: int = 0
    """Input delay of the model."""
    seconds: float | None = None
    """Processor time of the fit, of all its variants, once warm: the best of a few [s]."""
    first_seconds: float | None = None
    """Processor time of the first fit in a fresh process, after imports, with compilation where there is any [s]."""
    problem: str = ""
    """Why there is no model."""


def score_tool(tool: Tool, case: Case) -> list[Score]:
    """Fit a case by a tool and score each of its settings; a tool that can't be run gives scores that say why."""
    try:
        models = {model["variant"]: model for model in _fit(tool, case)}
    except NotRunError as error:
        return [Score(case.name, tool.name, setting, problem=str(error)) for setting in tool.entries]
    return [_score(tool, setting, case, [models[name] for name in tool.entries[setting]]) for setting in tool.entries]


def _fit(tool: Tool, case: Case) -> list[dict[str, Any]]:
    return list(run_adapter(tool, case_facts(ORDER, case.sample_period_s, *case.training)))


def case_facts(order: int, sample_period_s: float, inputs: Array, output: Array) -> dict[str, Any]:
    """Return a case as the adapters read it.

    Args:
      order: number of states.
      sample_period_s: sampling period [s].
      inputs: shape (N, m).
      output: shape (N, 1).
    """
    facts = {"order": order, "sample_period_s": sample_period_s}
    return {**facts, "inputs": inputs.tolist(), "output": output.tolist()}


def run_adapter(tool: Tool, facts: dict[str, Any]) -> Any:
    """Give a tool's adapter a case, or many, and return the models, as protocol.py describes both.

    Raises:
      NotRunError: if the tool can't be installed, ends with an error or takes too long.
    """
    words = environments.command(tool)
    with tempfile.TemporaryDirectory() as name:
        source, target = Path(name) / "case.json", Path(name) / "models.json"
        source.write_text(json.dumps(facts))
        try:
            ended = subprocess.run(
                [*words, str(source), str(target)],
                env={**os.environ, **SURROUNDINGS, "JAX_COMPILATION_CACHE_DIR": name},
                preexec_fn=_stay_on_one_core,
                capture_output=True,
                text=True,
                timeout=FIT_LIMIT_S,
            )
        except subprocess.TimeoutExpired as error:
            raise NotRunError(f"took more than {FIT_LIMIT_S} s") from error
        if ended.returncode or not target.is_file():
            said = (ended.stderr or ended.stdout).strip().splitlines()
            raise NotRunError(f"ended with status {ended.returncode}: {said[-1] if said else 'no message'}")
        return json.loads(target.read_text())


def _stay_on_one_core() -> None:
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def _score(tool: Tool, setting: str, case: Case, models: list[dict[str, Any]]) -> Score:
    good = [model for model in models if "error" not in model]
    if not good:
        return Score(case.name, tool.name, setting, problem="; ".join(model["error"] for model in models))
    scored = [_score_model(tool, setting, case, model) for model in good]
    best = max(scored, key=lambda score: -np.inf if score.training_fit_percent is None else score.training_fit_percent)
    return best._replace(
        seconds=sum(model["seconds"] for model in good),
        first_seconds=sum(model["first_seconds"] for model in good),
    )


def _score_model(tool: Tool, setting: str, case: Case, model: dict[str, Any]) -> Score:
    names = tuple(f"u{index}" for index in range(case.training[0].shape[1]))
    plant = PlantRecord(
        A=np.array(model["A"]).reshape(ORDER, ORDER),
        B=np.array(model["B"]).reshape(ORDER, len(names)),
        C=np.array(model["C"]).reshape(1, ORDER),
        D=np.array(model["D"]).reshape(1, len(names)),
        delay_samples=model.get("delay_samples", 0),
        sample_period_s=case.sample_period_s,
        input_names=names,
    )
    largest = float(np.abs(np.linalg.eigvals(plant.A)).max())
    score = Score(case.name, tool.name, setting, model["variant"], None, None, largest, plant.delay_samples)
    if largest > UNSTABLE:
        return score

    def fit(log: Log) -> float:
        recording = make_recording(*log, case.sample_period_s, input_names=names)
        return float(free_run(plant, recording, model.get("offset", 0.0)).fit_percent.item())

    return score._replace(test_fit_percent=fit(case.test), training_fit_percent=fit(case.training))
