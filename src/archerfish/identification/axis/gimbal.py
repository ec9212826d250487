"""Identification of one gimbal axis: recordings in, plant record out, eqs (11)–(16).

The input delay and whether the plant has a direct feedthrough are chosen by Bayes's information criterion among
refined fits; every plant it returns is stable. Several recordings are separate experiments on one plant, each with its
own initial state and offset (an encoder's zero is no property of the dynamics). Several outputs share the poles.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.identification.axis.drift import outputs_drift
from archerfish.identification.axis.informative_lines import heard_band
from archerfish.identification.axis.integrator import integration_remarks
from archerfish.identification.axis.log_ground import DRIFT, Ground
from archerfish.identification.axis.modal_form import Poles, sections_from_numbers, state_matrices
from archerfish.identification.axis.open_structures import (
    OpenStructure,
    mixture_deviations,
    mixture_interval,
    shares,
    weigh_structures,
)
from archerfish.identification.axis.pole_refinement import refine_poles
from archerfish.identification.axis.posterior_draws import draw_parameters
from archerfish.identification.axis.state_space import balanced
from archerfish.identification.axis.steady_gain import constrained_gain
from archerfish.identification.axis.structure_choice import Structure
from archerfish.identification.axis.structure_search import Found, search_plant
from archerfish.identification.axis.trust import PoleTrust, pole_remarks, trusted_poles
from archerfish.identification.axis.uncertainty import Posterior, posterior, steady_gain, transfer
from archerfish.identification.doctor.checks import check_recordings
from archerfish.identification.validation.free_run import common_offset, own_zero_run
from archerfish.identification.validation.frequency import driven_band_hz
from archerfish.records.errors import InputError
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording

Array = NDArray[np.float64]

DRAWS = 100
"""Posterior draws that a plant record carries."""
USUAL_DELAY = 20
"""Longest delay that is tried at first [samples]."""
_SAMPLES_A_DELAY, _SAMPLES_A_LATE_DELAY = 10, 4
"""Samples of the shortest recording for each sample of the longest delay: at first, and where the recordings call for
more."""
_BEYOND = 1.3
"""Longest delay that is tried over the one that the recordings call for."""


@dataclass(frozen=True)
class AxisIdentification:
    """An identified axis and how it came about."""

    plant: PlantRecord
    """The plant, stable and with well-scaled states, and draws from its posterior."""
    offset: Array
    """Constant between simulated and measured outputs that the recordings share, in their units, shape (p,)."""
    fit_percent: tuple[float, ...]
    """Fit of each training recording in free run, mean over the outputs [%]."""
    residual_sd: Array
    """Standard deviation of the training residuals of each output, in its units, shape (p,)."""
    delay_range: tuple[int, int]
    """Delays that the recordings don't reject at 95 % [samples]."""
    delay_weights: Mapping[int, float]
    """How likely each delay is, over all orders that were tried, a feedthrough counted as a sample less; empty if the
    order was given."""
    longest_delay: int
    """Longest delay that was allowed [samples]."""
    later_delay: int | None
    """A longer delay that explains the recordings clearly better than any that was allowed [samples]."""
    dc_gain_interval: tuple[tuple[float, float], ...]
    """95 % interval of the first output's steady gain per input."""
    poles: Poles
    """Poles in the z plane, slowest first, shape (order,)."""
    pole_sd: tuple[Array, Array]
    """Standard deviations of their real and imaginary parts, shape (order,) each."""
    determined: NDArray[np.bool_]
    """Whether the recordings determine each pole, shape (order,)."""
    excited_band_hz: tuple[float, float]
    """Lowest and highest frequency that the inputs excite [Hz]."""
    remarks: tuple[str, ...]
    """What may spoil the estimate, each a sentence."""
    parameters: Posterior
    """All parameters with their covariance, for outputs in units of `output_scale`, of the plant's own structure."""
    structures: tuple[OpenStructure, ...]
    """All structures that the recordings leave open, the plant's own first; the intervals are over all of them."""
    output_scale: Array
    """Unit of the parameters' outputs, shape (p,)."""
    integrating: bool
    """Whether the output runs on under a steady input, as far as the recordings tell."""
    drift: int
    """Highest power of time that the outputs drift with by themselves; 0 where they don't."""
    ground: Ground = field(repr=False)
    """The recordings as they were fitted."""

    def delay_certainty(self, share: float = 0.1) -> float:
        """Return how likely the delay is right within a sample or `share` of it, whichever is larger, 0…1."""
        weights = self.delay_weights
        if not weights:
            pairs = [(each.delay - each.known.feedthrough, each.weight) for each in self.structures]
            weights = {delay: sum(weight for other, weight in pairs if other == delay) for delay, _ in pairs}
        return weight_within(weights, self.plant.delay_samples - self.structures[0].known.feedthrough, share)

    def gain_interval(self, frequency_hz: Array) -> tuple[Array, Array]:
        """95 % interval of the gain |G| of the first output from the first input at frequencies [Hz], shape (F,)."""
        lag = np.exp(-2j * np.pi * frequency_hz * self.plant.sample_period_s)

        def gain(at: Posterior) -> Array:
            return np.asarray(np.abs(transfer(at, lag)[:, 0, 0]) * self.output_scale[0])

        return mixture_interval(self.structures, gain)


def weight_within(weights: Mapping[int, float], delay: int, share: float = 0.1) -> float:
    """Return the weight of all delays within a sample or `share` of one, whichever is larger."""
    within = max(1.0, share * delay)
    return sum(weight for other, weight in weights.items() if abs(other - delay) <= within)


def identify_axis(
    recordings: Sequence[Recording],
    order: int = 4,
    *,
    max_delay: int | None = USUAL_DELAY,
    axis: str = "axis",
    seed: int = 0,
    dc_gain: Sequence[float] | None = None,
    feedthrough: bool = True,
) -> AxisIdentification:
    """Identify the linear plant of an axis.

    Args:
      recordings: one input and any outputs, or any inputs and one output, the same and of the same sampling period in
        each; they are separate experiments.
      order: number of states.
      max_delay: longest input delay that is tried [samples]; None for as long as the recordings call for.
      axis: name for the record.
      seed: of the posterior draws.
      dc_gain: steady gain from each input to the one output, where it is known: the plant is held to it.
      feedthrough: whether the outputs may jump with an input; an angle can't, since the axis has inertia.

    Returns:
      The plant with its diagnostics.

    Raises:
      InputError: if the recordings can't bear the estimate; see `check_recordings`.
    """
    search = search_axis(recordings, order, max_delay=max_delay, dc_gain=dc_gain, feedthrough=feedthrough, drift=False)
    return complete_axis(search, axis=axis, seed=seed)


class AxisSearch(NamedTuple):
    """The structures that explain an axis' recordings with a given order, before anything is drawn from them."""

    recordings: Sequence[Recording]
    """As given."""
    order: int
    """Number of states."""
    longest_delay: int
    """Longest delay that was allowed [samples]."""
    scale: Array
    """Unit of the fits' outputs, shape (p,)."""
    found: Found
    """What was found."""
    remarks: Sequence[str]
    """What may spoil the estimate, each a sentence."""
    drifts: bool
    """Whether a slow drift of the outputs was fitted beside their response."""


def search_axis(
    recordings: Sequence[Recording],
    order: int,
    *,
    max_delay: int | None = None,
    dc_gain: Sequence[float] | None = None,
    feedthrough: bool = True,
    reached: int | None = None,
    drift: bool | None = None,
) -> AxisSearch:
    """Find the delays, feedthrough and poles that explain recordings best; arguments as those of `identify_axis`.

    Args:
      recordings: as there.
      order: as there.
      max_delay: as there.
      dc_gain: as there.
      feedthrough: as there.
      reached: longest delay that the search for a lower order came to, if there was one [samples].
      drift: whether the outputs drift, whatever the inputs; found out if not given.

    Raises:
      InputError: if the recordings can't bear the estimate; see `check_recordings`.
    """
    remarks = check_recordings(recordings, order)
    if max_delay is not None and max_delay < 0:
        raise InputError(f"max_delay must be at least 0, got {max_delay}; give the longest delay to try in samples")
    shortest = min(len(recording) for recording in recordings)
    longest = min(USUAL_DELAY if max_delay is None else max_delay, shortest // _SAMPLES_A_DELAY)
    longest = max(longest, reached or 0)
    scale = _spread(recordings)
    drifts = bool(drift)
    found = search_plant(recordings, order, longest, scale, feedthrough, drift=drifts)
    if drift is None and outputs_drift(found):
        drifts = True
        found = search_plant(recordings, order, longest, scale, feedthrough, drift=True)
    while max_delay is None and (wanted := _wanted_delay(found, longest, shortest, reached)) > longest:
        longest = wanted
        found = search_plant(recordings, order, longest, scale, feedthrough, drift=drifts)
    if scale.size > 1:
        # The most likely plant weighs each output by its noise, which only a fit can tell.
        scale = scale * np.sqrt(np.mean(found.best.refinement.fit.residuals.reshape(scale.size, -1) ** 2, axis=1))
        found = search_plant(recordings, order, longest, scale, feedthrough, drift=drifts)
    if dc_gain is not None:
        found = _with_gain(found, dc_gain, scale)
    return AxisSearch(recordings, order, longest, scale, found, remarks, drifts)


def _wanted_delay(found: Found, longest: int, shortest: int, reached: int | None) -> int:
    """Return up to which delay a search should have looked, at most what the shortest recording bears [samples]."""
    if found.later is not None:
        return max(longest, min(max(int(_BEYOND * found.later), longest + 1), shortest // _SAMPLES_A_LATE_DELAY))
    if reached is not None:
        return longest  # what a higher order makes of its spare poles and zeros is no reason to look further
    # A longer look costs samples where a recording doesn't begin at rest.
    most = shortest // (_SAMPLES_A_DELAY if any(found.ground.skips) else _SAMPLES_A_LATE_DELAY)
    return max(longest, min(2 * longest, most)) if found.delays[1] >= longest else longest


def complete_axis(search: AxisSearch, *, axis: str = "axis", seed: int = 0) -> AxisIdentification:
    """Weigh what was found, and say how sure it is.

    Args:
      search: of the axis.
      axis: name for the record.
      seed: of the posterior draws.
    """
    recordings, found, scale = search.recordings, search.found, search.scale
    structures = weigh_structures([found.best, *found.others], found.criteria)
    known = structures[0].known
    period = recordings[0].sample_period_s
    band = _band_hz(recordings, structures[0])
    trusts = [trusted_poles(each.known, each.fitted.refinement.sections, band, period) for each in structures]
    longest = max(len(recording) for recording in recordings)
    lowest = 2 * np.pi * period * band[0]
    gains = mixture_interval(structures, steady_gain)
    integrating = integration_remarks(structures[0].known, trusts[0], gains, lowest, longest, recordings[0].input_names)
    drawn = _drawn(structures, trusts, np.random.default_rng(seed))
    plant = _plant(recordings[0], structures[0].delay, known, drawn, scale, axis)
    drift = DRIFT if search.drifts else 0
    offset = common_offset(plant, recordings, drift=drift)
    # As in the fit, each recording has a zero of its own.
    runs = [own_zero_run(plant, each, drift=drift)[1] for each in recordings]
    low, high = (ends[0] * scale[0] for ends in gains)
    delays = found.delays
    return AxisIdentification(
        plant=plant,
        offset=offset,
        fit_percent=tuple(float(each.fit_percent.mean()) for each in runs),
        residual_sd=np.concatenate([each.residual for each in runs]).std(axis=0),
        delay_range=(min(delays[0], plant.delay_samples), max(delays[1], plant.delay_samples)),
        delay_weights=found.delay_weights,
        longest_delay=search.longest_delay,
        later_delay=found.later,
        dc_gain_interval=tuple(zip(low.tolist(), high.tolist(), strict=True)),
        poles=trusts[0].poles,
        pole_sd=_pole_deviations(structures, trusts),
        determined=trusts[0].determined,
        excited_band_hz=band,
        remarks=(*search.remarks, *integrating, *pole_remarks(trusts[0], period)),
        parameters=known,
        structures=structures,
        output_scale=scale,
        integrating=bool(integrating),
        drift=drift,
        ground=found.ground,
    )


def best_plant(search: AxisSearch) -> PlantRecord:
    """Return the likeliest plant that a search found, without draws."""
    best = search.found.best
    return _plant(search.recordings[0], best.delay, posterior(best.problem, best.refinement), [], search.scale, "axis")


def _with_gain(found: Found, gains: Sequence[float], scale: Array) -> Found:
    inputs = found.best.problem.experiments[0].inputs.shape[1]
    if scale.size > 1 or len(gains) != inputs or not np.all(np.isfinite(gains)):
        raise InputError(
            f"dc_gain must be one finite gain for each of {inputs} inputs of an axis with one output, "
            f"got {list(gains)} for {scale.size} outputs; give as many gains as inputs"
        )
    held = [_held(each, gains, float(scale[0])) for each in (found.best, *found.others)]
    return found._replace(best=held[0], others=tuple(held[1:]))


def _held(structure: Structure, gains: Sequence[float], scale: float) -> Structure:
    problem = constrained_gain(structure.problem, gains, scale)
    return structure._replace(problem=problem, refinement=refine_poles(structure.refinement.sections, problem))


def _band_hz(recordings: Sequence[Recording], best: OpenStructure) -> tuple[float, float]:
    """Frequencies that were excited on purpose, and those above at which the response stands out of the noise [Hz].

    Not those below: what the ends of a sweep leak there is seen, but at a few percent of its strength.
    """
    low, high = driven_band_hz(recordings)
    heard = heard_band(best.fitted.problem, best.fitted.refinement)
    highest = 0.0 if heard is None else heard[1] / (2 * np.pi * recordings[0].sample_period_s)
    return low, max(high, highest)


def _spread(recordings: Sequence[Recording]) -> Array:
    """Return the standard deviation of each output over all recordings, shape (p,)."""
    centred = np.concatenate([each.outputs - each.outputs.mean(axis=0) for each in recordings])
    return np.asarray(np.sqrt(np.mean(centred**2, axis=0)))


def _drawn(
    structures: Sequence[OpenStructure], trusts: Sequence[PoleTrust], generator: np.random.Generator
) -> list[tuple[int, Posterior]]:
    """Draw delays and parameters, from each structure as many as its weight is worth."""
    drawn = []
    for each, trust, count in zip(structures, trusts, shares([each.weight for each in structures], DRAWS), strict=True):
        if count:
            parameters = draw_parameters(each.known, trust.held, each.fitted.problem, count, generator)
            drawn += [(each.delay, one) for one in parameters]
    # In no order: the draws of two axes are taken in pairs, and some users take the first few.
    return [drawn[index] for index in generator.permutation(len(drawn))]


def _pole_deviations(structures: Sequence[OpenStructure], trusts: Sequence[PoleTrust]) -> tuple[Array, Array]:
    deviations = [(each.real_sd, each.imaginary_sd) for each in trusts]
    return mixture_deviations([each.poles for each in trusts], deviations, [each.weight for each in structures])


def _plant(
    recording: Recording,
    delay: int,
    known: Posterior,
    drawn: Sequence[tuple[int, Posterior]],
    scale: Array,
    axis: str,
) -> PlantRecord:
    matrices, *draws = (_matrices(each, scale) for each in (known, *(each for _, each in drawn)))
    plant = PlantRecord(
        **matrices,
        delay_samples=delay,
        sample_period_s=recording.sample_period_s,
        axis=axis,
        input_names=recording.input_names,
        output_names=recording.output_names,
        draws={name: np.stack([each[name] for each in draws]) for name in matrices} if draws else {},
        draw_delays=np.array([delay for delay, _ in drawn], np.int64),
    )
    return balanced(plant)


def _matrices(known: Posterior, scale: Array) -> dict[str, Any]:
    sections = sections_from_numbers(known.free)
    numerators = (known.linear[: known.order * known.inputs] * scale).reshape(known.order, known.inputs, scale.size)
    A, B, C = state_matrices(sections, numerators)
    D = np.zeros((scale.size, known.inputs))
    if known.feedthrough:
        D = (known.linear[known.order * known.inputs :] * scale).T
    return {"A": A, "B": B, "C": C, "D": D}
