"""Every array of every decision of a few engagements: to look at, or to work on in a notebook."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish2.dynamics.aiming import line_of_sight
from archerfish2.errors import InputError
from archerfish2.protocols import Command, Engagement, Seen, Shot

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Trajectory(NamedTuple):
    """N engagements of T decisions, NumPy's arrays that begin with (N, T)."""

    times: NDArray[np.float32]
    """Of the decisions since the engagement began [s], shape (T,); a pellet leaves a period later."""
    seen: Seen
    """What the controller saw."""
    command: Command
    """What it asked for."""
    in_force: NDArray[np.float32]
    """Pitch and yaw command during the period, after all limits [rad], shape (N, T, 2)."""
    shot: Shot
    """What became of the shot."""
    target: NDArray[np.float32]
    """Centre of the target's first plate when the pellet leaves [m], shape (N, T, 3)."""
    engagement: Engagement
    """The engagements, shape (N,)."""

    @property
    def hit(self) -> NDArray[np.bool_]:
        """Whether each decision hit, shape (N, T)."""
        return np.asarray(self.shot.fired & (self.shot.margin >= 0.0))

    def __repr__(self) -> str:
        decisions = len(self.times)
        engagements, rate, fields = self.hit.size // decisions, 100 * self.hit.mean(), ", ".join(self._fields)
        return f"Trajectory({engagements} engagements of {decisions} decisions, {rate:.1f} % hit; {fields})"

    def to_dicts(self) -> list[dict[str, Any]]:
        """Return a row per decision for a data frame: what was commanded, and what became of the shot."""
        engagement, decision = np.indices(self.hit.shape)
        columns: dict[str, Any] = {"engagement": engagement, "decision": decision, "time_s": self.times[decision]}
        angles = {"command": self.command.angle, "in_force": self.in_force, "gimbal": self.shot.angle}
        for name, angle in angles.items():
            columns |= {f"{name}_pitch_rad": angle[..., 0], f"{name}_yaw_rad": angle[..., 1]}
        columns |= {f"target_{axis}_m": self.target[..., place] for place, axis in enumerate("xyz")}
        columns |= {"fired": self.shot.fired, "hit": self.hit, "margin_m": self.shot.margin}
        columns |= {"miss_left_m": self.shot.miss[..., 0], "miss_up_m": self.shot.miss[..., 1]}
        columns["flight_time_s"] = self.shot.flight_time
        rows = zip(*(values.ravel().tolist() for values in columns.values()), strict=True)
        return [dict(zip(columns, row, strict=True)) for row in rows]

    def plot(self, engagement: int = 0) -> "Figure":
        """Draw yaw, pitch and miss of an engagement against time.

        Raises:
          InputError: if there is no engagement of that number.
        """
        from archerfish2.evaluation.plots import trajectory

        count = len(self.hit)
        if not -count <= engagement < count:
            raise InputError(f"plot: engagement must be 0…{count - 1}, got {engagement}; choose one of these")
        away = np.degrees(np.asarray(line_of_sight(self.target[engagement])))
        commands, angles = np.degrees(self.in_force[engagement]), np.degrees(self.shot.angle[engagement])
        period = float(self.times[1] - self.times[0]) if len(self.times) > 1 else 0.0
        return trajectory(self.times + period, away, commands, angles, self.shot.miss[engagement], self.hit[engagement])
