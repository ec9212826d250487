"""Findings: what is wrong with a recording, in a form that a person and a program can act on."""

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


def refusal(finding: Finding) -> InputError:
    """Build the error for a fault that can't be repaired."""
    return InputError(f"{finding.place}: {finding.message}; {finding.remedy}", finding.code)
