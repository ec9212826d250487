"""What the logs of commands would give: simulated logs, identified as measured ones are."""

import math
from collections.abc import Mapping

import numpy as np

from archerfish2.errors import InputError
from archerfish2.identification.axis.identify import AxisResult, identify_axis
from archerfish2.identification.simulation import Array, simulate
from archerfish2.logs.recording import Recording
from archerfish2.records.plant import PlantRecord

Prediction = tuple[dict[str, Recording], AxisResult]


def predict(commands: Mapping[str, Array], plant: PlantRecord, noise_sd: float, axis: str, seed: int) -> Prediction:
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
    rng, gain, fields = np.random.default_rng(seed), plant.dc_gain.item(), {"output_names": ("expected",)}
    logs = {}
    for name, u in commands.items():
        y = gain * u[0] + simulate(plant, u[:, None] - u[0])[:, 0] + noise_sd * rng.standard_normal(len(u))
        logs[name] = Recording.from_arrays(u, y, plant.sample_period_s, source=name, **fields)
    fitted, held_back = (
        [log for name, log in logs.items() if ("validation" in name) is held] for held in (False, True)
    )
    return logs, identify_axis(fitted, validate=held_back, axis=axis, order=len(plant.A), seed=seed)
