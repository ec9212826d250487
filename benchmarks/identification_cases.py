"""The recorded logs that identification is measured on: which signals, which part to fit and which to test.

Needs the recorded logs in ../shared/data, beside the repository. Inputs and outputs are less their training means, and
the same arrays go to every tool.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.io import loadmat

Array = NDArray[np.float64]
Log = tuple[Array, Array]
"""Inputs, shape (N, m), and output, shape (N, 1)."""

DATA = Path(__file__).parents[1] / ".." / "shared" / "data" / "identification"


class Case(NamedTuple):
    """One recorded system."""

    name: str
    """What it is called in tables."""
    log: str
    """Which signals of which file, and how they are split."""
    sample_period_s: float
    """Sampling period; 0.01 s where the source states none (no fit depends on it) [s]."""
    training: Log
    """What is fitted."""
    test: Log
    """What is simulated."""
    test_bar_percent: float | None
    """What our fit of the test part must reach [%]; None if the case is reported only."""


def real_cases() -> Iterator[Case]:
    """Yield every case, those with a bar first."""
    yield _halves("robot arm", "slicot_sysid/robot_arm_dat.mat", _column_matrix, [0], 1, bar=96.3)
    yield _halves("CD player arm", "slicot_sysid/CD_player_arm_dat.mat", _column_matrix, [0, 1], 3, bar=83.5)
    yield _halves("hair dryer", "rgp/dryer.dat", np.loadtxt, [0], 1, period_s=0.08, bar=86.5)
    yield _halves("Silverbox", "silverbox/SNLS80mV.csv", _silverbox, [0], 1, period_s=1 / 610.35, bar=87.2)
    multisine, steps = _drone("sinal4_multiseno"), _drone("sinal2_degraus")
    log = "quarter_drone/sinal4_multiseno → sinal2_degraus, reference → angle, each from sample 200"
    yield _case("quarter drone, steps", log, 0.01, multisine, steps, bar=88.3)
    sweep = _drone("sinal3_swept_sine")
    log = "quarter_drone/sinal3_swept_sine, reference → angle, from sample 200"
    yield _split("quarter drone, sweep", log, 0.01, sweep)
    # The drives' output is an absolute speed, which no linear model follows: a log to see the tools fail on.
    yield _split("coupled drives", "drgp_vss/drive.mat, u2 → z2", 0.02, _variables("drgp_vss/drive.mat", "u2", "z2"))
    random, fixed = (_variables(f"ball_and_hoop/{name}StepSequence.mat", "u", "y") for name in ("random", "fixed"))
    yield _case("ball and hoop", "ball_and_hoop/randomStepSequence → fixedStepSequence, u → y", 0.1, random, fixed)
    # The first of its 28 outputs.
    yield _halves("flexible structure", "slicot_sysid/flexible_structure_dat.mat", _column_matrix, [0, 1], 2)


def _halves(
    name: str,
    file: str,
    read: Callable[[Path], Array],
    inputs: list[int],
    output: int,
    *,
    period_s: float = 0.01,
    bar: float | None = None,
) -> Case:
    table = read(DATA / file)
    columns = f"columns {', '.join(str(column + 1) for column in inputs)} → {output + 1}"
    return _split(name, f"{file}, {columns}", period_s, (table[:, inputs], table[:, [output]]), bar)


def _split(name: str, log: str, period_s: float, whole: Log, bar: float | None = None) -> Case:
    inputs, output = whole
    middle = len(output) // 2
    first, second = (inputs[:middle], output[:middle]), (inputs[middle:], output[middle:])
    return _case(name, f"{log}; first half → second half", period_s, first, second, bar)


def _case(name: str, log: str, period_s: float, training: Log, test: Log, bar: float | None = None) -> Case:
    input_mean, output_mean = (signal.mean(axis=0) for signal in training)
    centred = [(inputs - input_mean, output - output_mean) for inputs, output in (training, test)]
    return Case(name, log, period_s, centred[0], centred[1], bar)


def _column_matrix(path: Path) -> Array:
    return np.asarray(loadmat(path)[path.stem], dtype=np.float64)


def _variables(file: str, input_name: str, output_name: str) -> Log:
    variables = loadmat(DATA / file)
    inputs, output = (np.asarray(variables[name], dtype=np.float64) for name in (input_name, output_name))
    return inputs, output


def _silverbox(path: Path) -> Array:
    """Read the first 20,000 samples of the multisine part."""
    table = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=(0, 1))
    return np.asarray(table[40650:60650], dtype=np.float64)


def _drone(name: str) -> Log:
    path = DATA / "quarter_drone" / f"{name}_malha_fechada.csv"
    table = np.loadtxt(path, delimiter=",", skiprows=1)[200:]
    return table[:, [1]], table[:, [2]]
