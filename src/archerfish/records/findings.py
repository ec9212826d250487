"""Findings: what is wrong with a recording, in a form that a person and a program can act on."""

from collections.abc import Iterable
from typing import Literal, NamedTuple

from archerfish.records.errors import InputError

Severity = Literal["refused", "repaired", "warning"]


class Finding(NamedTuple):
    """One fault of a log."""

    code: str
    """Short, stable name of the fault, for instance "time-backward"; docs/logs.md lists them."""
    severity: Severity
    """Whether the log can't be used, was repaired where that was certain, or may spoil the estimate."""
    place: str
    """The file, with the line, row, message or time where there is one."""
    message: str
    """What was found, and what was done about it."""
    remedy: str
    """What the user can do."""
    samples: int = 0
    """Samples of the log that were left out because of it."""


def left_out(findings: Iterable[Finding]) -> dict[str, int]:
    """Return how many samples were left out, by the code of the finding; findings that cost none are not in it."""
    counts: dict[str, int] = {}
    for finding in findings:
        if finding.samples:
            counts[finding.code] = counts.get(finding.code, 0) + finding.samples
    return counts


def refusal(finding: Finding) -> InputError:
    """Build the error for a fault that can't be repaired."""
    return InputError(f"{finding.place}: {finding.message}; {finding.remedy}", finding.code)
