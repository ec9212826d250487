"""The printed gimbal: two axes in state space, and the limits of their angles.

Pitch is eq (11), whose matrices eq (12) and eq (13) print. Yaw is eq (14), with those of eq (15) and eq (16).
"""

import math
from typing import NamedTuple

import numpy as np

from archerfish.paper import Legibility, facts
from archerfish.records.json_files import Matrix
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.records.plant import PlantRecord


class PrintedMatrix(NamedTuple):
    """One matrix of the paper, as it is printed and as we read it."""

    equation: int  # number of the equation that prints it
    printed: tuple[tuple[str, ...], ...]  # its entries, row by row, character for character
    values: Matrix  # our reading, before any scaling, in the shape that is printed
    legibility: Legibility


def printed_matrix(axis: str, name: str) -> PrintedMatrix:
    """Return a matrix of eq (12), eq (13), eq (15) or eq (16).

    Args:
      axis: "pitch" or "yaw".
      name: "A", "B" or "C".
    """
    found = facts("gimbal")[axis][name]
    printed = tuple(tuple(row) for row in found["printed"])
    as_printed = [[float(entry.replace(" ", "")) for entry in row] for row in printed]
    reading = found["reading"] if found["legibility"] == "damaged" else as_printed
    return PrintedMatrix(found["equation"], printed, np.array(reading), found["legibility"])


def printed_plants() -> dict[str, PlantRecord]:
    """Return the printed axes as "pitch", eq (11), and "yaw", eq (14).

    Departures from print:

    - The sampling period is not printed. It is taken as 1 ms.
    - Eq (11) and eq (14) give the angle at t + 1 from the state at t. We give it at t.
    - The damaged B of eq (15) is scaled so that the DC gain of yaw is 1. Pitch keeps its printed DC gain of 1.031.

    Angles are in any one unit: both plants map a commanded to a reached angle. The paper's frame has y to the right,
    but an axis whose command and angle both change sign stays the same.
    """
    return {"pitch": _plant("pitch"), "yaw": _plant("yaw")}


def _plant(axis: str) -> PlantRecord:
    A, B, C = (printed_matrix(axis, name) for name in "ABC")
    period = facts("gimbal")["sample_period_s"]["reading"]
    source = f"the paper, eqs ({A.equation}) and ({C.equation}), read as in docs/paper.md"
    plant = PlantRecord.from_state_space(A.values, B.values, C.values, 0.0, period)
    plant = plant.replace(axis=axis, provenance={"source": source})
    gain = facts("gimbal")[axis]["B"].get("scaled_to_dc_gain")
    return plant if gain is None else plant.with_dc_gain(gain)


def gate_limits() -> LimitsRecord:
    """Return the limits of a gimbal of GM6020 motors with the paper's angle ranges, for the command limit `gate`.

    The ranges are printed; the rates and accelerations are ours, since the printed linear axes have no limits.
    """
    pitch, yaw = (_axis_limits(**facts("limits")[axis]) for axis in ("pitch", "yaw"))
    return LimitsRecord(pitch=pitch, yaw=yaw, source=facts("limits")["source"])


def _axis_limits(low_deg: float, high_deg: float, **others: float) -> AxisLimits:
    return AxisLimits(low=math.radians(low_deg), high=math.radians(high_deg), **others)
