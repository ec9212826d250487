"""What commands on a wire have to keep, judged from the frames alone, with arithmetic of its own."""

import math
from collections import Counter

from archerfish.records.limits import LimitsRecord

TRANSIT_S = 0.025
"""From a report to a command that knows of it, at most: a decision period, and the way there and back [s]."""
_STALE_S = 0.05


class CommandMonitor:
    """Counts what the commands of a computer violate, in the order of the frames."""

    def __init__(self, limits: LimitsRecord, period_s: float, step: float = 0.0) -> None:
        """Begin without commands.

        Args:
          limits: of the robot.
          period_s: of the decisions [s].
          step: between two angles on the wire [rad].
        """
        self.violations = Counter[str]()
        """How often what was violated."""
        self._axes, self._period, self._step = (limits.pitch, limits.yaw), period_s, step
        self._last: list[float] | None = None
        self._rates = [0.0, 0.0]

    def command(self, angle: list[float] | None) -> None:
        """Judge the next command: pitch and yaw [rad], or None where the gimbal is to idle.

        Each is a period after the one before, whenever they arrive: a line delivers several at once.
        """
        if angle is not None and not all(map(math.isfinite, angle)):
            self.violations["not finite"] += 1
            return
        if angle is None:
            self._last = None
            return
        before = self._rates
        previous = self._last or angle
        self._rates = [(new - old) / self._period for new, old in zip(angle, previous, strict=True)]
        for axis, new, rate, earlier in zip(self._axes, angle, self._rates, before, strict=True):
            rounding = self._step / self._period
            largest_change = 1.01 * axis.max_acceleration * self._period + 1e-3 + 2.0 * rounding
            # A command may stand still at once, and begin again from there: the gimbal brakes by itself.
            is_sudden = abs(rate - earlier) > largest_change and abs(rate) > largest_change
            low, high = axis.ends
            self.violations["range"] += not low - 1e-5 - self._step <= new <= high + 1e-5 + self._step
            self.violations["rate"] += abs(rate) > 1.001 * axis.max_rate + rounding
            self.violations["acceleration"] += is_sudden
        self._last = angle

    def fire(self, time: float, informed_s: float, switch: bool) -> None:
        """Judge a fire at a time [s], with the time of the last undamaged report, and the operator's switch."""
        self.violations["fire while the switch is off"] += not switch
        self.violations["fire on old feedback"] += time - informed_s > _STALE_S + TRANSIT_S
