"""What all adapters share: read a case, fit it by each variant, time the fits, write the models.

An adapter is a script that runs in its tool's own environment as `python adapter.py CASE.json MODELS.json`, so this
module needs NumPy only. A case holds `order`, `sample_period_s`, `inputs` (N, m) and `output` (N, 1). A model holds
`variant` and either `error` or `A`, `B`, `C`, `D` and the seconds of its fit: `first_seconds` the first time in the
process, `seconds` the best of the later ones. `delay_samples` and `offset` are zero where they are missing.

To spare a tool its start for each of many cases, the file may hold `cases`, a list of them, and `variants`, the names
of those that are wanted. Each fit is then done once, and the models are a list for each case.

Times are processor times: the caller allows one core, so on a machine with nothing else to do they are what a clock on
the wall shows, and on a busy one they still are.
"""

import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

LATER_FITS = 5
PATIENCE_S = 2.0
"""No later fit is started once so much time has gone into them, beyond the first of them [s]."""


class Case(NamedTuple):
    """One identification problem."""

    order: int
    """Number of states."""
    sample_period_s: float
    """Sampling period [s]."""
    inputs: np.ndarray
    """Shape (N, m)."""
    output: np.ndarray
    """Shape (N, 1)."""


Model = Mapping[str, Any]
"""A, B, C, D and, where there are any, delay_samples and offset."""
Fit = Callable[[Case], Model]


def main(variants: Mapping[str, Fit]) -> None:
    """Fit the cases that the command line names, and write the models."""
    source, target = map(Path, sys.argv[1:])
    facts = json.loads(source.read_text())
    if "cases" not in facts:
        target.write_text(json.dumps([_attempt(name, fit, _case(facts)) for name, fit in variants.items()]))
        return
    wanted = {name: variants[name] for name in facts["variants"]}
    models = [
        [_attempt(name, fit, case, later_fits=0) for name, fit in wanted.items()] for case in map(_case, facts["cases"])
    ]
    target.write_text(json.dumps(models))


def _case(facts: Mapping[str, Any]) -> Case:
    return Case(facts["order"], facts["sample_period_s"], np.array(facts["inputs"]), np.array(facts["output"]))


def _attempt(variant: str, fit: Fit, case: Case, later_fits: int = LATER_FITS) -> dict[str, Any]:
    try:
        first_seconds, model = _timed(fit, case)
        later: list[float] = []
        while len(later) < later_fits and sum(later) < PATIENCE_S:
            later.append(_timed(fit, case)[0])
    except Exception as error:  # whatever a peer raises is that peer's result
        return {"variant": variant, "error": f"{type(error).__name__}: {error}"}
    matrices = {name: np.asarray(model[name], dtype=np.float64).tolist() for name in ("A", "B", "C", "D")}
    rest = {name: value for name, value in model.items() if name not in matrices}
    seconds = {"first_seconds": first_seconds, "seconds": min(later, default=first_seconds)}
    return {"variant": variant, **matrices, **rest, **seconds}


def _timed(fit: Fit, case: Case) -> tuple[float, Model]:
    start = time.process_time()
    model = fit(case)
    return time.process_time() - start, model
