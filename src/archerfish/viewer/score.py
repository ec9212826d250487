"""Hits so far in words: of the engagement that is shown, of all with their interval, and beside another controller."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.evaluation.hit_rate import Difference, HitRate, hit_rate, paired_difference
from archerfish.viewer.trial import Trial

Hits = NDArray[np.bool_]


class Score(NamedTuple):
    """How it stands at a moment."""

    hits: int
    """Of the engagement that is shown."""
    landed: int
    """Its pellets that have landed."""
    so_far: HitRate | None
    """Of the engagements that are over; None where an interval can't be given, for fewer than two."""


def score(trial: Trial, engagement: int, time: float) -> Score:
    """Count the hits up to a time [s] of an engagement."""
    landed = trial.fired_at + trial.flight_time[engagement] <= time
    over = engagement + bool(time >= trial.shown_s - 1e-6)
    so_far = hit_rate(trial.hit[:over], trial.fired[:over]) if over >= 2 else None
    return Score(int(np.sum(trial.hit[engagement] & landed)), int(np.sum(landed)), so_far)


def blocks(hit: Hits, shots: int) -> HitRate | None:
    """Return the rate of one long run, each block of so many shots taken for an engagement; None for fewer than two.

    Args:
      hit: whether each pellet hit, shape (N,).
      shots: per block.
    """
    count = hit.size // shots
    return hit_rate(hit[: count * shots].reshape(count, shots)) if count >= 2 else None


def rate_words(rate: HitRate | None) -> str:
    """Put a rate with its interval into words."""
    if rate is None:
        return "interval after two engagements"
    if not rate.shots:
        return f"no shot in {rate.engagements} engagements"
    return (
        f"{100 * rate.rate:.1f} % ({100 * rate.low:.1f}–{100 * rate.high:.1f}), "
        f"{rate.hits} of {rate.shots} in {rate.engagements} engagements"
    )


def count_words(trial: Trial) -> str:
    """Put hits and shots of a whole trial into words, and the decisions that withheld one or were left to a filter."""
    shots = int(trial.fired.sum())
    withheld = trial.fired.size - shots
    fallbacks = int(trial.fallback.sum())
    return ", ".join(
        [
            f"{int(trial.hit.sum())} of {shots} hit",
            *([f"{withheld} withheld"] if withheld else []),
            *([f"fell back on a Kalman filter at {fallbacks}"] if fallbacks else []),
        ]
    )


def compared(ours: Trial, theirs: Trial) -> Difference:
    """Compare two controllers that met the same targets, by the shots that each fired."""
    return paired_difference(ours.hit, theirs.hit, ours.fired, theirs.fired)


def difference_words(ours: str, theirs: str, found: Difference) -> str:
    """Put a comparison into words."""
    if not math.isfinite(found.difference):
        return f"{ours} − {theirs}: nothing to compare, one of them fired no shot"
    low, high = 100 * found.low, 100 * found.high
    numbers = f"{100 * found.difference:+.1f} points ({low:+.1f} to {high:+.1f})".replace("-", "−")
    return f"{ours} − {theirs}: {numbers}, same engagements"
