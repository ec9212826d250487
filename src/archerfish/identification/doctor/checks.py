"""Whether recordings in memory can bear an estimate; logs on disk are examined by the log doctor first."""

from collections.abc import Sequence

import numpy as np

from archerfish.identification.doctor.signals import saturation
from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

HIGHEST_ORDER = 8
"""Most states of an axis: beyond, a log of minutes tells no more of them."""
_SAMPLES_PER_PARAMETER = 10
_DEPENDENT = 1e-6
"""Length of what is left of an input beside the others, relative to it, below which rounding may be all there is."""


def check_recordings(recordings: Sequence[Recording], order: int) -> list[str]:
    """Refuse recordings from which an axis can't be identified.

    Args:
      recordings: recordings of one axis.
      order: order of the plant that is sought.

    Returns:
      Remarks on what may spoil the estimate, each a sentence.

    Raises:
      InputError: if there are none, they differ in signals or sampling period, have several inputs and several outputs,
        are too short for the order, a signal never changes, or an input is a mixture of the others.
    """
    if not recordings:
        raise InputError("identification needs at least one recording, got none; pass a log")
    if not 1 <= order <= HIGHEST_ORDER:
        raise InputError(f"order must be from 1 to {HIGHEST_ORDER}, got {order}; 4 suits a gimbal axis")
    _check_likeness(recordings)
    _check_lengths(recordings, order)
    for recording in recordings:
        _check_movement(recording)
    _check_independence(recordings)
    return [
        f"{finding.place}: {finding.message}; {finding.remedy}"
        for recording in recordings
        for finding in saturation(recording)
    ]


def fewest_samples(order: int) -> int:
    """Return how many samples a recording must have, next to others, to add to the estimate of an order."""
    return 5 * (order + 1)


def _check_likeness(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    if first.inputs.shape[1] > 1 and first.outputs.shape[1] > 1:
        raise InputError(
            f"{first.source}: an axis has one input or one output, got {first.inputs.shape[1]} inputs and "
            f"{first.outputs.shape[1]} outputs; take one output at a time"
        )
    for recording in recordings:
        for kind, found, expected in (
            ("inputs", recording.inputs.shape[1], first.inputs.shape[1]),
            ("outputs", recording.outputs.shape[1], first.outputs.shape[1]),
        ):
            if found != expected:
                raise InputError(
                    f"{recording.source}: has {found} {kind}, {first.source} has {expected}; "
                    "give recordings of the same signals"
                )
        if abs(recording.sample_period_s / first.sample_period_s - 1) > 0.01:
            raise InputError(
                f"{recording.source}: is sampled every {recording.sample_period_s:g} s, {first.source} every "
                f"{first.sample_period_s:g} s; resample one of them",
                "other-period",
            )


def _check_lengths(recordings: Sequence[Recording], order: int) -> None:
    inputs = recordings[0].inputs.shape[1]
    parameters = order + (order + 1) * inputs + len(recordings) * (order + 1)
    samples = sum(len(recording) for recording in recordings)
    needed = _SAMPLES_PER_PARAMETER * parameters
    if samples < needed:
        raise InputError(
            f"{recordings[0].source}: {samples} samples are too few for order {order}, which needs {needed} "
            f"({_SAMPLES_PER_PARAMETER} for each of {parameters} parameters); record longer or lower the order",
            "too-short",
        )
    for recording in recordings:
        if len(recording) < fewest_samples(order):
            raise InputError(
                f"{recording.source}: {len(recording)} samples are too few for order {order}, which needs "
                f"{fewest_samples(order)} in each recording; leave this log out",
                "too-short",
            )


def _check_movement(recording: Recording) -> None:
    for kind, names, signals in (
        ("input", recording.input_names, recording.inputs),
        ("output", recording.output_names, recording.outputs),
    ):
        for name, signal in zip(names, signals.T, strict=True):
            if np.ptp(signal) == 0:
                raise InputError(
                    f'{recording.source}: {kind} "{name}" is {signal[0]:g} throughout; '
                    f"record a log in which it changes, or name another column",
                    f"constant-{kind}",
                )


def _check_independence(recordings: Sequence[Recording]) -> None:
    inputs = np.concatenate([each.inputs - each.inputs.mean(axis=0) for each in recordings])
    unlike = np.linalg.svd(inputs / np.linalg.norm(inputs, axis=0), compute_uv=False)
    if unlike[-1] < _DEPENDENT:
        raise InputError(
            f"{recordings[0].source}: of the inputs {', '.join(recordings[0].input_names)} one is a copy or a mixture "
            "of the others throughout, so that their effects can't be told apart; leave one out",
            "dependent-inputs",
        )
