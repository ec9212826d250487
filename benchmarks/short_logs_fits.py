"""What our identification and its peers make of short logs: their fits of what was held back.

The peers get what helps them: the whole samples of the dead time are taken out of the input, as none of them looks for
it (as logged, they are scored too). Ours gets the file and nothing else.
"""

import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.cli.identify_gimbal import IdentifyGimbal, judge_logs
from archerfish.identification.axis.spectra import delayed
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.validation.free_run import fit_percent, free_run
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import make_recording
from peers.environments import NotRunError
from peers.roster import PEERS, Tool
from peers.running import UNSTABLE, case_facts, run_adapter
from short_logs_cases import ShortLog
from strangers_logs import write_log

Array = NDArray[np.float64]

ORDERS = (1, 2, 3, 4)
SETTINGS: dict[str, dict[str, tuple[str, ...]]] = {
    "Octave n4sid": {"": ("default s", "s = 10")},
    "nfoursid": {"": ("10 block rows", "20 block rows")},
    "SIPPY": {"": ("N4SID", "MOESP", "CVA", "PARSIM-K")},
    "ctrlsys": {"": ("10 block rows", "20 block rows")},
    "jax-sysid": {"introduction": ("introduction",), "1 start": ("seed 0",)},
}
"""Peer → setting → variants, of which the information criterion chooses along with the order."""
LOWEST = 0.0
"""Fit of a plant that is worse than no answer at all, or that there is none of [%]."""


class Found(NamedTuple):
    """What a tool made of a log."""

    fit_percent: float
    """Fit of what was held back [%]."""
    order: int = 0
    """Number of states; 0 without a plant."""
    delay: int = 0
    """Input delay [samples]."""
    feedthrough: bool = False
    """Whether the output jumps with the input."""
    note: str = ""
    """Variant that was taken, or why there is no plant."""


class Chosen(NamedTuple):
    """What a peer made of a log, by two rules for its order."""

    by_criterion: Found
    """With the order that Bayes's information criterion chooses."""
    by_truth: Found
    """With the order of the rig."""


def names() -> tuple[str, ...]:
    """Return the names of all peers and settings."""
    return tuple(_name(peer, setting) for peer, settings in SETTINGS.items() for setting in settings)


def _name(peer: str, setting: str) -> str:
    return f"{peer}, {setting}" if setting else peer


def our_fit(case: ShortLog) -> Found:
    """Identify a log as `archerfish identify gimbal` does, with no option, and score the plant."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            evidence, judgement = judge_logs(IdentifyGimbal(logs=write_log(case.log, Path(folder))))
        except InputError as error:
            return Found(LOWEST, note=str(error).replace(folder, "")[:160])
    plant = evidence.result.plant
    said = "usable" if judgement.usable else "unusable"
    return Found(_held_back(plant, case), len(plant.A), plant.delay_samples, bool(np.any(plant.D)), said)


def peer_fits(cases: Sequence[ShortLog], told: bool) -> list[dict[str, Chosen]]:
    """Identify logs by all peers and score their plants.

    Args:
      cases: the logs.
      told: whether the peers are told the dead time.

    Returns:
      For each log, what each peer and setting made of it.
    """
    found: list[dict[str, Chosen]] = [{} for _ in cases]
    for tool in PEERS:
        for setting, log_number, chosen in _scored(tool, cases, told):
            found[log_number][_name(tool.name, setting)] = chosen
    return found


def _scored(tool: Tool, cases: Sequence[ShortLog], told: bool) -> Iterator[tuple[str, int, Chosen]]:
    settings = SETTINGS[tool.name]
    logs = [_arrays(case, told) for case in cases]
    facts = [
        case_facts(order, case.log.period_s, *log) for case, log in zip(cases, logs, strict=True) for order in ORDERS
    ]
    variants = [each for some in settings.values() for each in some]
    try:
        models = iter(run_adapter(tool, {"variants": variants, "cases": facts}))
    except NotRunError as error:
        models = iter([[{"variant": name, "error": str(error)} for name in variants]] * len(facts))
    for number, (case, log) in enumerate(zip(cases, logs, strict=True)):
        of_log = [(order, model) for order in ORDERS for model in next(models)]
        for setting, some in settings.items():
            tried = [_Try.of(order, model, case, log, told) for order, model in of_log if model["variant"] in some]
            of_rig = [each for each in tried if each.found.order == case.log.rig.order]
            yield setting, number, Chosen(_best(tried), _best(of_rig))


def _arrays(case: ShortLog, told: bool) -> tuple[Array, Array]:
    """Return inputs and output of a log less their means, shape (N, 1) each."""
    file = case.log.files[0]
    inputs, output = file.inputs[:, None], file.outputs[:, None]
    if told:
        inputs = delayed(inputs, case.delay)
    return inputs - inputs.mean(), output - output.mean()


class _Try(NamedTuple):
    found: Found
    criterion: float

    @staticmethod
    def of(order: int, model: dict[str, Any], case: ShortLog, log: tuple[Array, Array], told: bool) -> "_Try":
        if "error" in model:
            return _Try(Found(LOWEST, order, note=model["error"][:160]), np.inf)
        # A scalar or a single row may have lost its brackets on the way.
        shapes = {"A": (order, order), "B": (order, 1), "C": (1, order), "D": (1, 1)}
        matrices = {name: np.array(model[name], dtype=np.float64).reshape(shape) for name, shape in shapes.items()}
        finite = all(np.isfinite(each).all() for each in matrices.values())
        if not finite or np.abs(np.linalg.eigvals(matrices["A"])).max() > UNSTABLE:
            return _Try(Found(LOWEST, order, note=f"{model['variant']}: unstable"), np.inf)
        plant = PlantRecord(**matrices, delay_samples=0, sample_period_s=case.log.period_s, input_names=("u",))
        residual = free_run(plant, make_recording(*log, case.log.period_s)).residual
        delay = case.delay if told else 0
        fit = _held_back(replace(plant, delay_samples=delay), case)
        count = len(residual)
        # Poles, zeros with gain and feedthrough, and the initial state.
        criterion = count * np.log(np.mean(residual**2)) + (3 * order + 1) * np.log(count)
        return _Try(Found(fit, order, delay, True, model["variant"]), float(criterion))


def _best(tried: Sequence[_Try]) -> Found:
    return min(tried, key=lambda each: each.criterion).found


def _held_back(plant: PlantRecord, case: ShortLog) -> float:
    """Return the fit of what was held back, simulated from rest [%]."""
    simulated = simulate(plant, case.given[:, None])
    fit = float(fit_percent(case.clean[:, None], simulated).item())
    return max(fit, LOWEST) if np.isfinite(fit) else LOWEST
