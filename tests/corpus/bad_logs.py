"""All bad logs of the corpus; importing them collects them."""

from . import bad_stamps, bad_values, unreadable_logs, unusual_logs
from .faults import FAULTS

__all__ = ["FAULTS", "bad_stamps", "bad_values", "unreadable_logs", "unusual_logs"]
