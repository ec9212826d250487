"""What identification must reach, on the recorded logs, in time and on the printed axes."""

from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from identification_cases import real_cases
from identification_printed import SweepAlone, SweepAndStep
from peers.roster import OURS
from peers.running import Score

BEHIND_BEST_TEST = 0.6
BEHIND_BEST_TRAINING = 0.1
TEST_RIVALS = {"hair dryer": "jax-sysid"}
"""Cases whose test fit is held against one tool: on the dryer Octave's default horizon fits the test part better than
the part it was fitted to, which is luck."""

TIMED_CASE = "Silverbox"
"""10,000 training samples of one input."""
SECONDS_LIMIT = 0.3
TIMES_FASTER = {("jax-sysid", "1 start"): 7.0, ("nfoursid", "20 block rows"): 14.0}

SWEEP_BARS = {
    0.01: {"sweep_fit_percent": 99.95, "step_fit_percent": 99.8, "white_fit_percent": 80.0, "pole_error": 2e-5},
    0.05: {"step_fit_percent": 99.4, "pole_error": 1.5e-4},
}
"""Noise → what the median over the seeds must reach."""
FLAGGED_AT_NOISE = 0.01
STEP_FIT_BAR = 99.0


class Bar(NamedTuple):
    """A figure and what it must be."""

    name: str
    """What is held against the bar."""
    found: float | None
    """The figure; None if there is none."""
    required: float
    """What it must be at least, or at most."""
    at_most: bool = False
    """Whether the figure must be at most `required`."""

    @property
    def met(self) -> bool:
        """Whether the bar is met."""
        if self.found is None:
            return False
        return self.found <= self.required if self.at_most else self.found >= self.required


def real_bars(scores: Sequence[Score]) -> Iterator[Bar]:
    """Yield the bars of the recorded logs that have one: absolute, and against the best peer of this run."""
    for case in real_cases():
        if case.test_bar_percent is None:
            continue
        here = [score for score in scores if score.case == case.name]
        ours = next(score for score in here if score.tool == OURS.name)
        peers = [score for score in here if score.tool != OURS.name]
        rivals = [score for score in peers if score.tool == TEST_RIVALS.get(case.name, score.tool)]
        best_test = _best(score.test_fit_percent for score in rivals)
        best_training = _best(score.training_fit_percent for score in peers)
        yield Bar(f"{case.name}: test fit", ours.test_fit_percent, case.test_bar_percent)
        if best_test is not None:
            yield Bar(
                f"{case.name}: test fit near the best peer's", ours.test_fit_percent, best_test - BEHIND_BEST_TEST
            )
        if best_training is not None:
            name = f"{case.name}: training fit near the best peer's"
            yield Bar(name, ours.training_fit_percent, best_training - BEHIND_BEST_TRAINING)


def _best(fits: Iterable[float | None]) -> float | None:
    return max((fit for fit in fits if fit is not None), default=None)


def speed_bars(scores: Sequence[Score]) -> Iterator[Bar]:
    """Yield the bars of the time: absolute, and against the peers of this run."""
    timed = {(score.tool, score.setting): score.seconds for score in scores if score.case == TIMED_CASE}
    seconds = timed[OURS.name, next(iter(OURS.entries))]
    yield Bar(f"{TIMED_CASE}: seconds", seconds, SECONDS_LIMIT, at_most=True)
    for peer, factor in TIMES_FASTER.items():
        if peer in timed:  # a peer that could not be run leaves its bar missed, not unsaid
            theirs = timed[peer]
            faster = None if seconds is None or theirs is None else theirs / seconds
            yield Bar(f"{TIMED_CASE}: times faster than {' '.join(peer)}", faster, factor)


def printed_bars(alone: Sequence[SweepAlone], with_step: Sequence[SweepAndStep]) -> Iterator[Bar]:
    """Yield the bars of the printed axes."""
    for noise, required in SWEEP_BARS.items():
        here = [each for each in alone if each.noise == noise]
        for name, bar in required.items():
            median = float(np.median([getattr(each, name) for each in here]))
            label = f"printed pitch, sweep, {noise:.0%} noise: {name.removesuffix('_percent').replace('_', ' ')}"
            yield Bar(label, median, bar, at_most=name == "pole_error")
        if noise == FLAGGED_AT_NOISE:
            flagged = sum(each.pair_flagged for each in here)
            yield Bar(f"printed pitch, sweep, {noise:.0%} noise: seeds with the fast pair flagged", flagged, len(here))
    for axis in sorted({each.axis for each in with_step}):
        worst = min(each.step_fit_percent for each in with_step if each.axis == axis)
        yield Bar(f"printed {axis}, sweep and step: worst step fit", worst, STEP_FIT_BAR)
