"""The printed gimbal: the state-space axes of eqs (11)–(16), and the limits of its angles."""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.paper.legibility import Legibility
from archerfish.records import storage
from archerfish.records.limits import AxisLimits, LimitsRecord
from archerfish.records.plant import PlantRecord


@dataclass(frozen=True)
class PrintedMatrix:
    """One matrix of the paper, as it is printed and as we read it."""

    equation: int
    """Number of the equation that prints it."""
    printed: tuple[tuple[str, ...], ...]
    """Its entries, row by row, character for character."""
    values: NDArray[np.float64]
    """Our reading, before any scaling, in the shape that is printed."""
    legibility: Legibility
    """How well it can be read."""
    note: str
    """What is odd about it."""


@functools.cache
def _facts() -> dict[str, Any]:
    return dict(storage.read_json(Path(__file__).with_name("gimbal.json")))


def printed_matrix(axis: str, name: str) -> PrintedMatrix:
    """Return a matrix of eqs (12), (13), (15) or (16).

    Args:
      axis: "pitch" or "yaw".
      name: "A", "B" or "C".
    """
    facts = _facts()[axis][name]
    printed = tuple(tuple(row) for row in facts["printed"])
    legibility = Legibility(facts["legibility"])
    reading = facts["reading"] if legibility is Legibility.DAMAGED else _parse(printed)
    return PrintedMatrix(facts["equation"], printed, np.array(reading), legibility, facts["note"])


def _parse(printed: tuple[tuple[str, ...], ...]) -> list[list[float]]:
    return [[float(entry.replace(" ", "")) for entry in row] for row in printed]


def printed_plants() -> dict[str, PlantRecord]:
    """Return the printed axes of eqs (11)–(16) as "pitch" and "yaw".

    Departures from print: the sampling period, which is not printed, is taken as 1 ms; eqs (11) and (14) give the angle
    at t + 1 from the state at t, we give it at t; the damaged B_y is scaled so that the DC gain of yaw is 1. Pitch
    keeps its printed DC gain of 1.031. Angles are in any one unit: both plants map a commanded to a reached angle.
    """
    return {axis: _plant(axis) for axis in ("pitch", "yaw")}


def _plant(axis: str) -> PlantRecord:
    a, b, c = (printed_matrix(axis, name) for name in ("A", "B", "C"))
    plant = PlantRecord(
        A=a.values,
        B=b.values,
        C=c.values,
        D=np.zeros((1, 1)),
        delay_samples=0,
        sample_period_s=_facts()["sample_period_s"]["reading"],
        axis=axis,
        provenance={"source": f"the paper, eqs ({a.equation}) and ({c.equation}), read as in docs/errata.md"},
    )
    gain = _facts()[axis]["B"].get("scaled_to_dc_gain")
    return plant if gain is None else plant.with_dc_gain(gain)


def gate_limits() -> LimitsRecord:
    """Return the limits of a gimbal of GM6020 motors with the paper's angle ranges, which the safety gate enforces.

    The ranges are printed; the rates and accelerations are ours, since the printed linear axes have no limits.
    """
    facts = storage.read_json(Path(__file__).with_name("limits.json"))
    return LimitsRecord(_axis_limits(facts["pitch"]), _axis_limits(facts["yaw"]), source=facts["source"])


def _axis_limits(facts: dict[str, float]) -> AxisLimits:
    low, high = np.deg2rad([facts["low_deg"], facts["high_deg"]]).tolist()
    return AxisLimits(low, high, max_rate=facts["max_rate"], max_acceleration=facts["max_acceleration"])
