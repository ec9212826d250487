"""What the logs of planned commands would give: simulated logs, identified as measured ones are."""

import math
from collections.abc import Mapping

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.simulation import Array, simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord


def predict(
    commands: Mapping[str, Array], plant: PlantRecord, noise_sd: float, axis: str, seed: int
) -> tuple[dict[str, Recording], AxisResult]:
    """Simulate the logs of commands from rest, with white noise, and identify a plant of the same order from them.

    Args:
      commands: by the name of their log [rad], shape (N,) each; those with "validation" in it are held back.
      plant: of one input and one output.
      noise_sd: standard deviation of the measured angle's noise [rad].
      axis: its name.
      seed: of noise and identification.

    Returns:
      The logs by name, with columns "u" and "expected", and what the identification makes of them.

    Raises:
      InputError: if the plant has several inputs or outputs, or its logs would not determine it.
    """
    if plant.D.shape != (1, 1) or not 0 <= noise_sd < math.inf:
        got = f"got {plant.D.shape} and {noise_sd:g}; correct it"
        raise InputError(f"excitation: expected a plant of one output and one input, and noise_sd ≥ 0, {got}")
    rng, gain, logs, period_s = np.random.default_rng(seed), plant.dc_gain.item(), {}, plant.sample_period_s
    for name, u in commands.items():
        y = gain * u[0] + simulate(plant, u[:, None] - u[0])[:, 0] + noise_sd * rng.standard_normal(len(u))
        logs[name] = Recording.from_arrays(u, y, period_s, output_names=("expected",), source=name)
    held_back = [log for name, log in logs.items() if "validation" in name]
    fitted = [log for log in logs.values() if log not in held_back]
    return logs, identify_axis(fitted, validate=held_back, axis=axis, order=len(plant.A), seed=seed)
