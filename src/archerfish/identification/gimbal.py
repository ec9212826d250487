"""Identification of one gimbal axis: recordings in, plant record out, eqs (11)–(16).

The input delay and whether the plant has a direct feedthrough are chosen by Bayes's information criterion among
refined fits; every plant it returns is stable. Several recordings are separate experiments on one plant, each with its
own initial state and offset (an encoder's zero is no property of the dynamics).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from archerfish.identification.checks import check_recordings
from archerfish.identification.frequency import beyond_band, excited_band_hz, natural_frequency_hz
from archerfish.identification.modal_form import Poles, state_matrices
from archerfish.identification.pole_refinement import Refinement
from archerfish.identification.simulation_fit import Structure
from archerfish.identification.state_space import balanced, plant_poles
from archerfish.identification.structure_search import score_starts, search_structure
from archerfish.identification.validation import common_offset, free_run
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording


@dataclass(frozen=True)
class AxisIdentification:
    """An identified axis and how it came about."""

    plant: PlantRecord
    """The plant, stable and with well-scaled states."""
    offset: float
    """Constant between simulated and measured output that the recordings share, in units of the output."""
    fit_percent: tuple[float, ...]
    """Fit of each training recording in free run [%]."""
    residual_sd: float
    """Standard deviation of the training residuals, in units of the output."""
    delay_scan: dict[int, float]
    """Delay [samples] → root mean square of the training residuals before refinement."""
    poles: Poles
    """Poles in the z plane, slowest first, shape (order,)."""
    excited_band_hz: tuple[float, float]
    """Lowest and highest frequency that the inputs excite [Hz]."""
    remarks: tuple[str, ...]
    """What may spoil the estimate, each a sentence."""


def identify_axis(
    recordings: Sequence[Recording], order: int = 4, *, max_delay: int = 20, axis: str = "axis"
) -> AxisIdentification:
    """Identify the linear plant of an axis.

    Args:
      recordings: m inputs and one output each, of the same signals and sampling period; they are separate experiments.
      order: number of states.
      max_delay: longest input delay that is tried [samples].
      axis: name for the record.

    Returns:
      The plant with its diagnostics.

    Raises:
      InputError: if the recordings can't bear the estimate; see `check_recordings`.
    """
    remarks = check_recordings(recordings, order)
    if max_delay < 0:
        raise InputError(f"max_delay must be at least 0, got {max_delay}; give the longest delay to try in samples")
    max_delay = min(max_delay, min(len(recording) for recording in recordings) // 10)
    starts = score_starts(recordings, order, max_delay)
    band = excited_band_hz(recordings)
    structure, refinement = search_structure(recordings, starts, band)
    plant = _plant(recordings[0], refinement, structure, axis)
    poles = plant_poles(plant)
    offset = common_offset(plant, recordings)
    scan = {start.delay: start.cost for start in reversed(starts)}
    samples = sum(len(recording) for recording in recordings)
    return AxisIdentification(
        plant=plant,
        offset=offset.item(),
        fit_percent=tuple(free_run(plant, recording, offset).fit_percent.item() for recording in recordings),
        residual_sd=float(np.sqrt(refinement.fit.cost / samples)),
        delay_scan={delay: float(np.sqrt(scan[delay] / samples)) for delay in sorted(scan)},
        poles=poles,
        excited_band_hz=band,
        remarks=(*remarks, *_undetermined(poles, band, plant.sample_period_s)),
    )


def _plant(recording: Recording, refinement: Refinement, structure: Structure, axis: str) -> PlantRecord:
    A, C = state_matrices(refinement.sections)
    plant = PlantRecord(
        A=A,
        B=refinement.fit.B,
        C=C,
        D=refinement.fit.D,
        delay_samples=structure.delay,
        sample_period_s=recording.sample_period_s,
        axis=axis,
        input_names=recording.input_names,
        output_names=recording.output_names,
    )
    return balanced(plant)


def _undetermined(poles: Poles, band: tuple[float, float], sample_period_s: float) -> list[str]:
    remarks = []
    for pole in poles[beyond_band(poles, band, sample_period_s) & (poles.imag >= 0)]:
        frequency = natural_frequency_hz(pole, sample_period_s)
        place = f"{pole.real:.3f} ± {pole.imag:.3f}i" if pole.imag else f"{pole.real:.3f}"
        remarks.append(
            f"The pole at z = {place} ({frequency:.3g} Hz) lies above the excited {band[0]:.3g}–{band[1]:.3g} Hz: "
            "these recordings say little about it."
        )
    return remarks
