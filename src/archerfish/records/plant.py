"""The plant record: the identified (or printed) linear model of one gimbal axis, eqs (11)–(16).

x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]
"""

from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.records import storage
from archerfish.records.errors import InputError, file_error

SCHEMA, _OLDER = "archerfish.plant/2", "archerfish.plant/1"
Matrix = NDArray[np.float64]

USABLE_FIT_PERCENT = 80.0
"""Below it more than a fifth of the motion is unexplained; clean logs of a gimbal give 95 % and more."""


@dataclass(frozen=True)
class PlantQuality:
    """How well an identified plant foretells its logs, and whether that is good enough to be used."""

    usable: bool
    """Whether the identification found the plant good for anything."""
    fit_percent: float
    """Fit of the log by which it was judged [%]: the worst that was held back, else the worst fitted."""
    log: str
    """Which log that was."""
    held_back: bool
    """Whether that log was held back from the fit."""


@dataclass(frozen=True)
class PlantRecord:
    """A linear axis with input delay, and how sure we are of it.

    With draws (a sample from the posterior of an identification) the matrices have a leading axis in `draws`; the
    matrices themselves are the best estimate. A draw may have a delay of its own.
    """

    A: Matrix
    """State matrix, shape (n, n)."""
    B: Matrix
    """Input matrix, shape (n, m)."""
    C: Matrix
    """Output matrix, shape (p, n)."""
    D: Matrix
    """Feedthrough, shape (p, m)."""
    delay_samples: int
    """Input delay [samples]."""
    sample_period_s: float
    """Sampling period [s]."""
    axis: str = "axis"
    """Which axis this is: "pitch", "yaw", or any name."""
    input_names: tuple[str, ...] = ("command",)
    """Names of the m inputs."""
    output_names: tuple[str, ...] = ("angle",)
    """Names of the p outputs."""
    draws: dict[str, Matrix] = field(default_factory=dict)
    """Posterior draws: "A" (k, n, n), "B" (k, n, m), "C" (k, p, n), "D" (k, p, m); empty where there are none."""
    quality: PlantQuality | None = None
    """How well it foretells its logs; None where that is not known, as in a record that was written by hand."""
    draw_delays: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """Input delay of each draw [samples], shape (k,); empty where all draws have that of the best estimate."""
    provenance: dict[str, Any] = field(default_factory=dict)
    """Seed, commit, library versions and input hashes of the making."""

    def __post_init__(self) -> None:
        n, m, p = self.A.shape[0], self.B.shape[-1], self.C.shape[0]
        expected = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        for name, shape in expected.items():
            _check_matrix(name, getattr(self, name), shape)
        if self.draws:
            if self.draws.keys() != expected.keys():
                raise InputError(f"plant.draws must hold A, B, C and D, got {', '.join(sorted(self.draws))}")
            for name, shape in expected.items():
                _check_matrix(f"draws[{name}]", self.draws[name], (len(self.draws["A"]), *shape))
        self._check_delays()
        if not 0 < self.sample_period_s < np.inf:
            raise InputError(f"plant.sample_period_s must be > 0 s, got {self.sample_period_s}; identify the axis anew")

    def _check_delays(self) -> None:
        if self.delay_samples < 0:
            raise InputError(f"plant.delay_samples must be ≥ 0, got {self.delay_samples}; identify the axis anew")
        count = len(self.draws["A"]) if self.draws else 0
        if self.draw_delays.shape not in ((0,), (count,)):
            raise InputError(
                f"plant.draw_delays must have shape ({count},), got {self.draw_delays.shape}; identify the axis anew"
            )
        if np.any(self.draw_delays < 0):
            raise InputError(f"plant.draw_delays must be ≥ 0, got {self.draw_delays.min()}; identify the axis anew")

    def delays_of_draws(self) -> NDArray[np.int64]:
        """Return the input delay of each draw [samples], shape (k,); k is 0 without draws."""
        count = len(self.draws["A"]) if self.draws else 0
        return self.draw_delays if self.draw_delays.size else np.full(count, self.delay_samples, np.int64)

    def with_dc_gain(self, gain: float) -> "PlantRecord":
        """Return the plant of one input and output with B scaled so that its DC gain is `gain`."""
        return replace(self, B=self.B * (gain / dc_gain(self).item()))


def _check_matrix(name: str, found: Matrix, shape: tuple[int, ...]) -> None:
    if found.shape != shape:
        raise InputError(f"plant.{name} must have shape {shape}, got {found.shape}; identify the axis anew")
    if not np.all(np.isfinite(found)):
        raise InputError(f"plant.{name} holds a value that is not finite; identify the axis anew")


def dc_gain(plant: PlantRecord) -> Matrix:
    """Return the steady output per steady input, C (I − A)⁻¹ B + D, shape (p, m)."""
    eye = np.eye(plant.A.shape[0])
    return np.asarray(plant.C @ np.linalg.solve(eye - plant.A, plant.B) + plant.D)


def write_plant(path: Path, plant: PlantRecord) -> None:
    """Write a plant record to `path` (.json) and its matrices beside it."""
    arrays = {name: getattr(plant, name) for name in ("A", "B", "C", "D")}
    arrays |= {f"draws_{name}": draws for name, draws in plant.draws.items()}
    arrays["draw_delays"] = plant.draw_delays
    facts = {
        "axis": plant.axis,
        "delay_samples": plant.delay_samples,
        "sample_period_s": plant.sample_period_s,
        "input_names": list(plant.input_names),
        "output_names": list(plant.output_names),
        "provenance": plant.provenance,
    }
    if plant.quality is not None:
        facts["quality"] = asdict(plant.quality)
    storage.write_record(path, SCHEMA, facts, arrays)


def read_plant(path: Path) -> PlantRecord:
    """Read a plant record.

    Raises:
      InputError: if the file is not a plant record or does not hold together.
    """
    facts, arrays = storage.read_record(path, SCHEMA, _OLDER)
    missing = {"A", "B", "C", "D"} - arrays.keys()
    if missing:
        raise file_error(path, f"matrix {sorted(missing)[0]} is missing", "identify the axis anew")
    try:
        return PlantRecord(
            **{name: arrays[name] for name in ("A", "B", "C", "D")},
            delay_samples=storage.field(path, facts, "delay_samples", int),
            sample_period_s=float(storage.field(path, facts, "sample_period_s", (int, float))),
            axis=storage.field(path, facts, "axis", str),
            input_names=tuple(storage.field(path, facts, "input_names", list)),
            output_names=tuple(storage.field(path, facts, "output_names", list)),
            draws={name.removeprefix("draws_"): array for name, array in arrays.items() if name.startswith("draws_")},
            # In the first version all draws had the delay of the best estimate.
            draw_delays=arrays.get("draw_delays", np.zeros(0, np.int64)),
            provenance=storage.field(path, facts, "provenance", dict),
            quality=_quality(path, facts["quality"]) if facts.get("quality") is not None else None,
        )
    except InputError as error:
        raise error if str(path) in str(error) else InputError(f"{path}: {error}") from error


def _quality(path: Path, facts: Any) -> PlantQuality:
    known = {each.name for each in fields(PlantQuality)}
    if not isinstance(facts, dict) or facts.keys() != known:
        raise file_error(path, f'field "quality" must hold {", ".join(sorted(known))}', "identify the axis anew")
    return PlantQuality(
        usable=storage.field(path, facts, "usable", bool),
        fit_percent=float(storage.field(path, facts, "fit_percent", (int, float))),
        log=storage.field(path, facts, "log", str),
        held_back=storage.field(path, facts, "held_back", bool),
    )
