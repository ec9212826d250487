"""What the logs of a robot told, as results.json holds it."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class RobotStep:
    """A step of a robot's axis beside that of the identified model."""

    axis: str
    """"pitch" or "yaw"."""
    size_deg: float
    """Of the commanded step [degrees]."""
    time_s: tuple[float, ...]
    """Time since the step [s], shape (N,)."""
    measured_deg: tuple[float, ...]
    """Angle of the robot [degrees], shape (N,)."""
    model_deg: tuple[float, ...]
    """Angle of the identified model [degrees], shape (N,)."""
    fit_percent: float
    """NRMSE fit of the two from the step on, each counted from its rest before it [%]."""


@dataclass(frozen=True)
class LandingRow:
    """One pair of angles of Table I on a robot, and where the identified muzzle lets pellets fall."""

    pitch_deg: float
    """Elevation, as the robot reports it [degrees]."""
    yaw_deg: float
    """Azimuth, left positive [degrees]."""
    shots: int
    """Fired there."""
    robot_m: float
    """Mean distance of the robot's falling points [m]."""
    robot_low_m: float
    """Lower end of its 95 % interval [m]."""
    robot_high_m: float
    """Upper end [m]."""
    model_m: float
    """As the identified muzzle foretells [m]; it was identified from hits on plates."""
    error_percent: float
    """Model less robot [%]."""


@dataclass(frozen=True)
class RobotIdentification:
    """What the logs of a robot told, and how well."""

    robot: str
    """Its name."""
    axes: dict[str, dict[str, Any]]
    """"pitch" and "yaw" → facts."""
    facts: dict[str, dict[str, Any]]
    """"sensing" and "muzzle" → facts."""
    landings: tuple[LandingRow, ...]
    """Table I proper."""
    steps: tuple[RobotStep, ...]
    """Fig. 4 proper."""
