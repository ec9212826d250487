"""What recordings of torque and angle can't tell of a rigid axis, said with the movement that is missing."""

from collections.abc import Mapping, Sequence

import numpy as np

from archerfish.records.errors import InputError
from archerfish.records.recording import Recording
from archerfish.records.rigid_axis import AxisKind

_SEPARABLE = 1 / 3
"""Largest standard error of a parameter, as a share of it, that counts as knowledge: three of them to nothing."""

_SMALL_MOMENT = 0.05
"""Share of the largest torque below which a moment of gravity does not matter, known or not."""

_USABLE_FIT_PERCENT = 80.0

FEWEST_SAMPLES = 50
"""Samples that a recording must hold."""


def check_rigid_recordings(recordings: Sequence[Recording], torque_per_unit: float, segment_s: float) -> None:
    """Refuse recordings that hold no torque or no movement.

    Raises:
      InputError: if there are none, they differ in signals or sampling period, are short, or a signal never changes.
    """
    if not recordings:
        raise InputError("identification needs at least one recording, got none; pass a log")
    if torque_per_unit == 0 or not np.isfinite(torque_per_unit):
        raise InputError(f"the torque per unit of the input must be finite and not 0, got {torque_per_unit:g}")
    if not (segment_s == 0 or 0.05 <= segment_s < np.inf):
        raise InputError(f"segments must be 0 (whole recordings) or at least 0.05 s long, got {segment_s:g} s")
    first = recordings[0]
    for each in recordings:
        if each.inputs.shape[1] != 1 or each.outputs.shape[1] not in (1, 2):
            raise InputError(f"{each.source}: a rigid axis has one torque, one angle and at most one rate")
        if each.output_names != first.output_names or abs(each.sample_period_s / first.sample_period_s - 1) > 0.01:
            raise InputError(
                f"{each.source}: has other signals or another sampling period than {first.source}; "
                "give recordings of the same kind"
            )
        if len(each) < FEWEST_SAMPLES:
            raise InputError(
                f"{each.source}: {len(each)} samples are too few, {FEWEST_SAMPLES} are needed; record longer"
            )
        for kind, name, signal in (
            ("torque", each.input_names[0], each.inputs[:, 0]),
            ("angle", each.output_names[0], each.outputs[:, 0]),
        ):
            if np.ptp(signal) == 0:
                raise InputError(
                    f'{each.source}: {kind} "{name}" is {signal[0]:g} throughout; record a log in which it changes, or '
                    "name another column"
                )


def check_separable(
    recordings: Sequence[Recording],
    axis_kind: AxisKind,
    estimates: Mapping[str, float],
    standard_errors: Mapping[str, float],
) -> None:
    """Refuse an estimate whose parameters the recordings leave open.

    Raises:
      InputError: with the movement that would settle them.
    """
    source = ", ".join(recording.source for recording in recordings)
    if not standard_errors["inertia"] <= _SEPARABLE * estimates["inertia"]:
        raise InputError(
            f"{source}: the inertia can't be told (standard error {standard_errors['inertia']:.2g} of "
            f"{estimates['inertia']:.2g}): the torque hardly accelerates the axis. Record a log that speeds up and "
            "slows down, a sweep for instance; at constant speed the torque shows friction alone"
        )
    if axis_kind == "pitch":
        _check_gravity(source, recordings, estimates, standard_errors)


def _check_gravity(
    source: str, recordings: Sequence[Recording], estimates: Mapping[str, float], standard_errors: Mapping[str, float]
) -> None:
    moment = estimates["gravity_moment"]
    loose = max(standard_errors["gravity_moment"], moment * standard_errors["gravity_phase"])
    # Largest torque that was at work, in N m: what gravity and inertia had to hold against.
    torque = estimates["inertia"] * max(map(_largest_acceleration, recordings)) + moment
    if loose <= max(_SEPARABLE * moment, _SMALL_MOMENT * torque):
        return
    reach = max(float(np.ptp(recording.outputs[:, 0])) for recording in recordings)
    raise InputError(
        f"{source}: moment and direction of gravity can't be told apart (standard error {loose:.2g} N m): the axis "
        f"moved over {np.degrees(reach):.2g}° only, so gravity was all but a constant torque. Record a slow movement "
        "through the whole travel"
    )


def _largest_acceleration(recording: Recording) -> float:
    """Guess the largest acceleration [rad/s²] from the angle's spread and its crossings of the mean."""
    angle = recording.outputs[:, 0] - recording.outputs[:, 0].mean()
    crossings = int(np.count_nonzero(np.diff(np.signbit(angle))))
    omega = np.pi * max(crossings, 1) / (len(angle) * recording.sample_period_s)
    return float(omega**2 * angle.std())


def rigid_remarks(
    estimates: Mapping[str, float], standard_errors: Mapping[str, float], fits: Sequence[float]
) -> list[str]:
    """Say what is doubtful in an estimate, each a sentence."""
    remarks = []
    if min(fits) < _USABLE_FIT_PERCENT:
        remarks.append(
            f"The rigid model misses {100 - min(fits):.0f} % of the motion: backlash, cogging, friction that grows at "
            "rest, or mixed units; don't trust the parameters."
        )
    damping, error = estimates["damping"], standard_errors["damping"]
    if damping < -3 * error:
        remarks.append("The damping is negative, which no axis is: check the units and the torque's sign.")
    elif abs(damping) < 3 * error and "friction" in estimates:
        remarks.append("Damping and Coulomb friction are hardly told apart: record stretches at several speeds.")
    elif abs(damping) < 3 * error:
        remarks.append("The damping is within three standard errors of nothing: its interval is all that is known.")
    return remarks
