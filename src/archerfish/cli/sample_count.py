"""How many samples of the logs an identification used, and why it left out others."""

from collections.abc import Iterable
from typing import Any, NamedTuple

from archerfish.records.findings import Finding, left_out

_REASONS = {
    "truncated": "in a last line that breaks off",
    "late-input": "before the first message of an input",
    "missing-values": "in rows that lack a value",
    "time-duplicate": "that repeat the one before",
    "short-piece": "in pieces between gaps too short to use",
    "constant-input": "in pieces in which an input rests",
    "constant-output": "in pieces in which an output rests",
}
"""Code of a finding → where the samples are that it left out."""


class SampleCount(NamedTuple):
    """Samples of the logs of an identification."""

    held: int
    """Samples that the logs hold; where stamps were uneven, before resampling."""
    left_out: dict[str, int]
    """Code of a finding → samples that were left out because of it."""

    @property
    def used(self) -> int:
        """Samples that were used."""
        return self.held - sum(self.left_out.values())


def count_samples(held: int, findings: Iterable[Finding]) -> SampleCount:
    """Count what findings left out of the samples that the logs hold."""
    return SampleCount(held, left_out(findings))


def used_words(count: SampleCount) -> str:
    """Write how many samples were used, for a headline."""
    return f"{count.used} of {count.held} samples used" if count.left_out else f"all {count.held} samples used"


def used_sentence(count: SampleCount) -> str:
    """Write how many samples were used, and where those are that were left out."""
    reasons = [f"{number} {_REASONS.get(code, f'({code})')}" for code, number in count.left_out.items()]
    words = used_words(count)
    return f"{words[0].upper()}{words[1:]}{'; left out: ' if reasons else ''}{', '.join(reasons)}."


def sample_facts(count: SampleCount) -> dict[str, Any]:
    """Return the counts that --json writes."""
    return {"held": count.held, "used": count.used, "left_out": dict(count.left_out)}
