"""What is wrong with the recordings, said before a model is fitted to them."""

from collections.abc import Sequence

import numpy as np

from archerfish.records.errors import InputError
from archerfish.records.recording import Recording

_SAMPLES_PER_PARAMETER = 10
_SATURATED_SHARE = 0.05


def check_recordings(recordings: Sequence[Recording], order: int) -> list[str]:
    """Refuse recordings from which an axis can't be identified.

    Args:
      recordings: recordings of one axis.
      order: order of the plant that is sought.

    Returns:
      Remarks on what may spoil the estimate, each a sentence.

    Raises:
      InputError: if there are none, they differ in signals or sampling period, have several outputs, are too short for
        the order, or a signal never changes.
    """
    if not recordings:
        raise InputError("identification needs at least one recording, got none; pass a log")
    if order < 1:
        raise InputError(f"order must be at least 1, got {order}; 4 suits a gimbal axis")
    _check_likeness(recordings)
    _check_lengths(recordings, order)
    for recording in recordings:
        _check_movement(recording)
    return [remark for recording in recordings for remark in _saturation(recording)]


def _check_likeness(recordings: Sequence[Recording]) -> None:
    first = recordings[0]
    for recording in recordings:
        if recording.outputs.shape[1] != 1:
            raise InputError(
                f"{recording.source}: an axis has one output, got {recording.outputs.shape[1]}; take one at a time"
            )
        if recording.inputs.shape[1] != first.inputs.shape[1]:
            raise InputError(
                f"{recording.source}: has {recording.inputs.shape[1]} inputs, {first.source} has "
                f"{first.inputs.shape[1]}; give recordings of the same signals"
            )
        if abs(recording.sample_period_s / first.sample_period_s - 1) > 0.01:
            raise InputError(
                f"{recording.source}: is sampled every {recording.sample_period_s:g} s, {first.source} every "
                f"{first.sample_period_s:g} s; resample one of them"
            )


def _check_lengths(recordings: Sequence[Recording], order: int) -> None:
    inputs = recordings[0].inputs.shape[1]
    parameters = order + (order + 1) * inputs + len(recordings) * (order + 1)
    samples = sum(len(recording) for recording in recordings)
    needed = _SAMPLES_PER_PARAMETER * parameters
    if samples < needed:
        raise InputError(
            f"{recordings[0].source}: {samples} samples are too few for order {order}, which needs {needed} "
            f"({_SAMPLES_PER_PARAMETER} for each of {parameters} parameters); record longer or lower the order"
        )
    for recording in recordings:
        if len(recording) < 5 * (order + 1):
            raise InputError(
                f"{recording.source}: {len(recording)} samples are too few for order {order}, which needs "
                f"{5 * (order + 1)} in each recording; leave this log out"
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
                    f"record a log in which it changes, or name another column"
                )


def _saturation(recording: Recording) -> list[str]:
    """Remark on signals of many different values that often sit at their extreme; a step has few values."""
    remarks = []
    for name, signal in zip(
        (*recording.input_names, *recording.output_names), [*recording.inputs.T, *recording.outputs.T], strict=True
    ):
        share = max(np.mean(signal == signal.max()), np.mean(signal == signal.min()))
        if share > _SATURATED_SHARE and np.unique(signal).size > 20:
            remarks.append(
                f'{recording.source}: "{name}" sits at its extreme for {share:.0%} of the samples; if it was cut off '
                "there, a linear plant can't follow."
            )
    return remarks
