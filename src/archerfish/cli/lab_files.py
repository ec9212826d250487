"""What a laboratory leaves beside its logs, for those who read them; nothing here knows the robot."""

from dataclasses import dataclass
from pathlib import Path

from archerfish.records import storage
from archerfish.records.errors import file_error

LARGE_STEPS_DEG = {"pitch": (2.0, -5.0, -15.0), "yaw": (2.0, 10.0, 30.0)}
"""Axis → steps of Fig. 4: small ones and such as saturate the motor; a robot that turns less far makes less of them."""


@dataclass(frozen=True)
class Tape:
    """What a tape measures on a robot."""

    muzzle_length_m: float
    """From the gimbal's pivot to the muzzle."""
    muzzle_height_m: float
    """Of the muzzle above the ground, with the barrel level."""


def read_tape(path: Path) -> Tape:
    """Read what was measured by tape (tape.json).

    Raises:
      InputError: if the file is missing, or holds other fields.
    """
    facts = storage.read_json(path)
    try:
        return Tape(**{name: float(value) for name, value in facts.items()})
    except (AttributeError, TypeError, ValueError) as error:
        raise file_error(
            path, "expected the numbers muzzle_length_m and muzzle_height_m", "measure them by tape"
        ) from error
