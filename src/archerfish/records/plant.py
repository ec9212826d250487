"""The plant record: the identified (or printed) linear model of one gimbal axis, eq (11) and eq (14).

x[t+1] = A x[t] + B u[t − delay],    y[t] = C x[t] + D u[t − delay]
"""

from typing import Annotated, Any, Self

import numpy as np
from msgspec import Meta, field

from archerfish.arrays import real_array
from archerfish.errors import InputError, checked_arguments
from archerfish.records.json_files import Counts, Matrix, SampleCount
from archerfish.records.record import Provenance, Record, Text

LARGEST_SIZES, _LARGEST_EXPANDED = {"states": 64, "inputs": 16, "outputs": 16, "draws": 1000}, 2000
"""States, those of the delay included, of the largest plant that is written out."""
Names = Annotated[tuple[str, ...], Meta(min_length=1)]


class PlantRecord(Record, frozen=True, kw_only=True):
    """A linear axis with input delay, and how certain it is.

    With draws (a sample from the posterior of an identification) the matrices have a leading axis in `draws`; the
    matrices themselves are the best estimate. A draw may have a delay of its own.
    """

    schema = "archerfish.plant/3"
    A: Matrix
    """State matrix, shape (n, n)."""
    B: Matrix
    """Input matrix, shape (n, m)."""
    C: Matrix
    """Output matrix, shape (p, n)."""
    D: Matrix
    """Feedthrough, shape (p, m)."""
    delay_samples: SampleCount = 0
    """Input delay d of the equations [samples]; `dead_time_samples` is how late the output responds."""
    sample_period_s: Annotated[float, Meta(ge=1e-6, le=1e6)]
    """Sampling period [s]."""
    axis: Text = "axis"
    """Which axis this is: "pitch", "yaw", or any name."""
    input_names: Names = ("command",)
    """Names of the m inputs."""
    output_names: Names = ("angle",)
    """Names of the p outputs."""
    draws: dict[str, Matrix] = field(default_factory=dict)
    """Posterior draws: "A" (k, n, n), "B" (k, n, m), "C" (k, p, n), "D" (k, p, m); empty where there are none."""
    draw_delays: Counts = np.zeros(0, np.int64)
    """Input delay of each draw [samples], shape (k,); empty where all draws have that of the best estimate."""
    validation_residual: Annotated[float, Meta(ge=0.0, le=1e6)] | None = None
    """Largest residual of the first output, in its unit, that lasted three decisions of 20 ms in logs that were held
    back; None where there were none. It judges feedback on the robot, and is not part of the robot's digest."""
    provenance: Provenance = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__post_init__()
        sizes = (self.A.shape[-1:], self.B.shape[-1:], self.C.shape[:1])
        n, m, p = (size[0] if size else 0 for size in sizes)
        shapes = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        count = len(self.draws.get("A", ())) if self.draws else 0
        for name, size in {"states": n, "inputs": m, "outputs": p, "draws": max(count, 1)}.items():
            if not 1 <= size <= LARGEST_SIZES[name]:
                raise InputError(f"PlantRecord: expected 1…{LARGEST_SIZES[name]} {name}, got {size}; correct it")
        expected: dict[str, tuple[int, ...]] = shapes | {"input_names": (m,), "output_names": (p,)}
        found: dict[str, tuple[int, ...]] = {name: np.shape(getattr(self, name)) for name in expected}
        if self.draws:
            found |= {f"draws[{name}]": matrices.shape for name, matrices in self.draws.items()}
            expected |= {f"draws[{name}]": (count, *shape) for name, shape in shapes.items()}
        if self.draw_delays.shape != (0,):
            found["draw_delays"], expected["draw_delays"] = self.draw_delays.shape, (count,)
        for name in expected | found:
            if found.get(name) != expected.get(name):
                got, wanted = found.get(name, "none"), expected.get(name, "none")
                raise InputError(f"PlantRecord: field {name}: expected shape {wanted}, got {got}; correct it")

    def __repr__(self) -> str:
        draws = f", {len(self.draws['A'])} draws" if self.draws else ""
        delay_ms = 1e3 * self.dead_time_samples * self.sample_period_s
        return f"PlantRecord({self.axis}: order {len(self.A)}, delay {delay_ms:.3g} ms{draws})"

    @classmethod
    @checked_arguments
    def second_order(
        cls, natural_hz: float, damping: float, delay_s: float = 0.0, sample_period_s: float = 1e-3, gain: float = 1.0
    ) -> Self:
        """Return gain ω² / (s² + 2 ζ ω s + ω²) under commands that are held for a sampling period.

        Args:
          natural_hz: ω / 2π [Hz].
          damping: ζ.
          delay_s: of the input [s], a multiple of the sampling period.
          sample_period_s: of the plant [s].
          gain: steady output per steady input.

        Raises:
          InputError: if a number is out of range.
        """
        from scipy.linalg import expm

        for name, value in {"natural_hz": natural_hz, "damping": damping, "sample_period_s": sample_period_s}.items():
            if not 0.0 < value < 1e6:
                raise InputError(f"PlantRecord.second_order: {name} must be > 0 and < 1e6, got {value}; correct it")
        samples = delay_s / sample_period_s
        if not (0.0 <= samples <= 1e6 and abs(samples - round(samples)) < 1e-6 * max(samples, 1.0)):
            expected = f"delay_s must be a multiple of the sampling period {sample_period_s} s, got {delay_s}"
            raise InputError(f"PlantRecord.second_order: {expected}; choose a shorter sample_period_s")
        w = 2.0 * np.pi * natural_hz * sample_period_s  # time in sampling periods, so that both states are angles
        held = expm(np.array([[0.0, w, 0.0], [-w, -2.0 * damping * w, gain * w], [0.0, 0.0, 0.0]]))
        A, B, C = held[:2, :2], held[:2, 2:], np.eye(1, 2)
        return cls(A=A, B=B, C=C, D=np.zeros((1, 1)), delay_samples=round(samples), sample_period_s=sample_period_s)

    @classmethod
    @checked_arguments
    def from_state_space(
        cls, A: Any, B: Any = None, C: Any = None, D: Any = None, dt: float | None = None, delay_samples: int = 0
    ) -> Self:
        """Return a plant in discrete time, from its matrices or from an object that has them.

        Args:
          A: shape (n, n); or an object with A, B, C, D and dt, as `control.ss` and `scipy.signal.dlti` make them.
          B: shape (n, m).
          C: shape (p, n).
          D: shape (p, m), or one number.
          dt: sampling period [s].
          delay_samples: input delay that the matrices don't contain [samples].

        Raises:
          InputError: if the model is continuous, shapes disagree, or a value is out of range.
        """
        if B is None and hasattr(A, "A"):
            A, B, C, D, dt = A.A, A.B, A.C, A.D, A.dt
        if B is None or not dt or dt is True:
            problem = f"expected matrices and a period dt above 0 s, or what has them as control.ss, got dt {dt}"
            remedy = "discretise a continuous model (control.c2d(system, 0.001) or scipy.signal.cont2discrete)"
            raise InputError(f"PlantRecord.from_state_space: {problem}; {remedy}")
        A, B, C, D = (np.atleast_2d(real_array("from_state_space", matrix)) for matrix in (A, B, C, D))
        D = np.full((len(C), B.shape[-1]), D[0, 0]) if D.size == 1 else D
        names: Any = {"input_names": _names("command", B.shape[-1]), "output_names": _names("angle", len(C))}
        return cls(A=A, B=B, C=C, D=D, delay_samples=delay_samples, sample_period_s=dt, **names)

    def to_state_space(self) -> tuple[Matrix, Matrix, Matrix, Matrix, float]:
        """Return A, B, C, D and the sampling period, with the delay as further states.

        Raises:
          InputError: if the delay is too long for that.
        """
        n, m, late = len(self.A), self.B.shape[1], self.delay_samples
        if late == 0:
            return self.A, self.B, self.C, self.D, self.sample_period_s
        if (size := n + m * late) > _LARGEST_EXPANDED:
            found = f"the plant with its delay of {late} samples has {size} states"
            raise InputError(f"{found}, expected at most {_LARGEST_EXPANDED}; use its matrices and delay_samples")
        # After x come the inputs of the last periods, the newest first; the oldest m drive the plant.
        A, B = np.eye(size, k=-m), np.eye(size, m, k=-n)
        A[: n + m] = 0.0
        A[:n, :n], A[:n, -m:] = self.A, self.B
        C = np.hstack([self.C, np.zeros((len(self.C), m * (late - 1))), self.D])
        return A, B, C, np.zeros_like(self.D), self.sample_period_s

    @property
    def dead_time_samples(self) -> int:
        """How late the output responds, beyond the sample that a held input takes: the delay that reports state.

        It is `delay_samples`, with a feedthrough, which responds a sample earlier, one less, but at least 0.
        """
        return max(self.delay_samples - int(self.D.any()), 0)

    @property
    def dc_gain(self) -> Matrix:
        """Steady output per steady input, C (I − A)⁻¹ B + D, shape (p, m).

        Raises:
          InputError: if the plant integrates.
        """
        try:
            return np.asarray(self.C @ np.linalg.solve(np.eye(len(self.A)) - self.A, self.B) + self.D)
        except np.linalg.LinAlgError as error:
            raise InputError(f"the {self.axis} plant integrates and has no DC gain; close its loop") from error

    def with_dc_gain(self, gain: float) -> Self:
        """Return the plant of one input and output, scaled at its input so that its DC gain is `gain`."""
        scale = gain / self.dc_gain.item()
        draws = {name: scale * matrix if name in "BD" else matrix for name, matrix in self.draws.items()}
        return self.replace(B=scale * self.B, D=scale * self.D, draws=draws)

    def delays_of_draws(self) -> Counts:
        """Return the input delay of each draw [samples], shape (k,); k is 0 without draws."""
        count = len(self.draws["A"]) if self.draws else 0
        return self.draw_delays if self.draw_delays.size else np.full(count, self.delay_samples, np.int64)


def _names(name: str, count: int) -> tuple[str, ...]:
    return (name,) if count == 1 else tuple(f"{name}_{number}" for number in range(1, count + 1))
