"""A plant of a user's own: a function of the axis instead of a file, for instance from first principles."""

from dataclasses import replace

import numpy as np

from archerfish.records.errors import InputError
from archerfish.records.extensions import Extension, find_extension, own_code
from archerfish.records.plant import PlantRecord


def find_plant(spec: str, axis: str) -> tuple[PlantRecord, Extension]:
    """Return the plant of an axis, and where it comes from.

    Args:
      spec: ./FILE.py:NAME, MODULE:NAME, or the name of an entry point of the group `archerfish.plants`; a function
        that is given the axis, or a `PlantRecord`.
      axis: "pitch" or "yaw".

    Raises:
      InputError: if it can't be found, fails, returns something else, or can't be the plant of a gimbal's axis.
    """
    found = find_extension(spec, "plant")
    with own_code(found):
        plant = found.value(axis) if callable(found.value) else found.value
        _check(plant, axis)
    return replace(plant, axis=axis), found


def _check(plant: object, axis: str) -> None:
    if not isinstance(plant, PlantRecord):
        wanted = "expected an archerfish.records.plant.PlantRecord"
        raise InputError(f"gives a {type(plant).__name__} for the {axis} axis, {wanted}; return one")
    if plant.axis in {"pitch", "yaw"} - {axis}:
        raise InputError(f"gives the plant of the {plant.axis} axis for {axis}; heed the axis that it is given")
    if plant.B.shape[1] != 1:
        raise InputError(f"the {axis} plant has {plant.B.shape[1]} inputs, expected one, the commanded angle")
    largest = float(np.max(np.abs(np.linalg.eigvals(plant.A)), initial=0.0))
    if largest >= 1.0:
        raise InputError(
            f"the {axis} plant has a pole of magnitude {largest:.4g}, expected less than 1, for a gimbal follows an "
            "angle command and comes to rest; close its loop, and sample it in discrete time"
        )
