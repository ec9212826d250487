"""Archerfish: from the logs of a two-axis gimbal to a policy that out-shoots classical auto-aim."""

__version__ = "0.2.0"
