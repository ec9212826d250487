"""A virtual robot at the other end of a wire, without port and clock: its frames, its camera's datagrams, its operator.

Faults come by time and are seeded, so each is repeatable. Commands are judged by a monitor that has the robot's limits
and nothing of the computer's code.
"""

import json
import math
import random
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from archerfish.errors import InputError, meant
from archerfish.messages import Numbers
from archerfish.records.limits import UNLIMITED, LimitsRecord
from archerfish.virtual_robot.batch import MovingPlate, RobotBatch
from archerfish.virtual_robot.description import TICK_S, RobotDescription
from archerfish.virtual_robot.flights import Received
from archerfish.virtual_robot.monitor import TRANSIT_S, CommandMonitor
from archerfish.virtual_robot.servo import GimbalServo
from archerfish.wires import Stream
from archerfish.wires.layout import Layout
from archerfish.wires.wire import TableWire

_CAMERA_CLOCK_S, _OTHER_CLOCK_S = 54_321.5, 3600.0  # the camera's clock, and another one, less the robot's
_LATE_S = 0.2
_HEAT_LIMIT, _HEAT_OF_SHOT, _COOLING = 200.0, 10.0, 40.0  # of a 17 mm barrel in RoboMaster, cooling in 1/s
_REFEREE_S = 0.1  # between frames of the referee system
_DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "flip": lambda frame, rng: _flipped(frame, rng.randrange(8 * len(frame))),
    "triple": lambda frame, _: 3 * frame,
    "garbage": lambda frame, rng: (
        rng.randbytes(rng.randrange(60)) + frame[: rng.choice([len(frame), rng.randrange(len(frame))])]
    ),
    "silence": lambda _, __: b"",
}
"""What happens to the bytes of a frame, in this order."""
FAULTS = (*_DAMAGES, "frozen", "nan", "late", "burst", "camera-clock", "blind", "nan-detections", "hidden")
"""Kinds of faults: of the frames, with late ones 0.2 s late and a burst's all at its end, then of the camera; a hidden
plate is in none of its frames."""


class Fault(NamedTuple):
    """Something that is wrong for a while."""

    kind: str  # one of `FAULTS`
    begin_s: float  # since the start
    end_s: float  # since the start


class Delivery(NamedTuple):
    """What reaches the computer."""

    time_s: float  # since the start
    is_datagram: bool  # of the camera, else bytes of the wire
    data: bytes  # of some frames, or of a datagram
    informs_s: float = -math.inf  # when the undamaged report in it would have arrived without a fault, since the start


class Pellet(NamedTuple):
    """A pellet as it leaves, and what becomes of it."""

    time_s: float  # since the start
    is_hit: bool  # whether it hits the plate
    command: Numbers  # in force: pitch and yaw [rad], (2,)
    angle: Numbers  # of the gimbal: pitch and yaw [rad], (2,)
    plate: Numbers  # where the plate is, in O [m], (3,)
    miss: Numbers  # where it passes the plate's centre: left and up [m], NaN if never, (2,)


class Emulator:
    """One virtual robot; times are seconds since the start."""

    def __init__(
        self,
        description: RobotDescription,
        limits: LimitsRecord,
        wire: TableWire,
        target: MovingPlate,
        period_s: float,
        *,
        seed: int = 0,
        switch_on_s: Sequence[tuple[float, float]] = ((1.0, math.inf),),
        faults: Sequence[Fault] = (),
        watchdog_s: float = 0.0,
        servo: GimbalServo | None = None,
    ) -> None:
        """Start the robot.

        Args:
          description: of the virtual robot.
          limits: that its commands have to keep.
          wire: of the robot.
          target: what moves before it; its position is needed from −0.2 s on.
          period_s: of the decisions; a pellet leaves so long after the command that fires it [s].
          seed: of all noise and of the faults.
          switch_on_s: begin and end of each time during which the operator's switch is on [s].
          faults: what goes wrong.
          watchdog_s: for so long the microcontroller goes on firing, a pellet a period, if no command comes; with 0 a
            command fires one pellet [s].
          servo: of one gimbal, in the place of the description's.

        Raises:
          InputError: if there is no such kind of fault, the wire can't be emulated, or its report has no room for the
            limits.
        """
        for fault in faults:
            if fault.kind not in FAULTS:
                remedy = meant(fault.kind, FAULTS, "name one of these")
                raise InputError(f"fault: expected one of {', '.join(FAULTS)}, got {fault.kind!r}; {remedy}")
            if not 0.0 <= fault.begin_s < fault.end_s:
                got = f"got {fault.begin_s:g} and {fault.end_s:g} s"
                raise InputError(f"fault {fault.kind}: expected a begin before its end, {got}; exchange them")
        wire.check_complete()
        _check_room(wire.layouts[wire.report], limits)
        if wire.layouts[wire.report].step("yaw") and any(fault.kind == "nan" for fault in faults):
            raise InputError("fault nan: the angles of this wire are whole numbers; choose another fault, or flip")
        self._robots = RobotBatch(description, 1, np.array([seed]), servo=servo)
        self._target, self._hit_radius, self._period = target, description.referee.hit_radius_m, period_s
        self._wire, self._switch_times, self._faults = wire, switch_on_s, faults
        self._stream = Stream(wire.layouts[name] for name, table in wire.tables.items() if table.sent)
        self._rng, self._normals = random.Random(seed), np.random.default_rng(seed)
        step = max(layout.step("yaw") for layout in wire.layouts.values() if "yaw" in layout.names)
        self.monitor = CommandMonitor(limits, period_s, step)
        self.trial_s = 0.0
        """From here on count the times of the switch and of faults [s]."""
        self.pellets = list[Pellet]()
        """That have left."""
        self.informed_s = -math.inf
        """When the newest undamaged report that has arrived would have done so without a fault [s]."""
        self._due, self._last_frame, self._line_free_s = list[float](), b"", -math.inf
        others = [name for name, table in wire.tables.items() if name != wire.report and not table.sent]
        self._of_referee = [wire.layouts[name] for name in others if "shots_left" in wire.layouts[name].names]
        self._heat, self._cooled_s, self._referee_s = 0.0, 0.0, -math.inf
        self._watchdog, self._commanded_s, self._repeat_s = watchdog_s, -math.inf, math.inf
        start = [float(np.clip(0.0, *axis.ends)) for axis in (limits.pitch, limits.yaw)]
        self._queue = [*self._arrivals(self._robots.reset(np.array([start]), target, lead_s=0.2))]

    @property
    def hits(self) -> list[tuple[float, bool]]:
        """When each pellet left [s], and whether it hit."""
        return [(pellet.time_s, pellet.is_hit) for pellet in self.pellets]

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self._robots.time

    def advance(self, ticks: int) -> list[Delivery]:
        """Run ticks of a millisecond, and return what reaches the computer in them, in its order."""
        end = round(self.time / TICK_S) + ticks
        while (present := round(self.time / TICK_S)) < end:
            self._shoot_what_is_due()
            following = min([end, *(round(due / TICK_S) for due in self._due)])
            self._queue += self._arrivals(self._robots.advance(following - present))
        self._shoot_what_is_due()
        self._queue.sort(key=lambda arrival: arrival.time_s)
        arrived = [arrival for arrival in self._queue if arrival.time_s <= self.time]
        self._queue = self._queue[len(arrived) :]
        self.informed_s = max([self.informed_s, *(arrival.informs_s for arrival in arrived)])
        return arrived

    def on_bytes(self, data: bytes) -> None:
        """Take bytes of the computer at the present time."""
        for frame in self._stream.feed(data):
            values, table = frame.layout.decode(frame.data), self._wire.tables[frame.layout.name]
            states = {state for state, numbers in table.sent.items() if numbers.items() <= values.items()}
            self._commanded_s, self._repeat_s = self.time, math.inf
            if states == {"idle"}:
                self.monitor.command(None)
            elif states and "idle" not in states and {"pitch", "yaw"} <= values.keys():
                angle = [values["pitch"], values["yaw"]]
                self.monitor.command(angle)
                if np.all(np.isfinite(angle)):
                    self._robots.send(np.array([angle]))
            if states == {"fire"}:
                was_on = self._switch_at(min(self.time - TRANSIT_S, self.informed_s))  # as the computer could know
                self.monitor.fire(self.time, self.informed_s, was_on or self.is_switch_on)
                self._due.append(self.time + self._period)
                self._repeat_s = self.time + 2.0 * self._period

    def _shoot_what_is_due(self) -> None:
        now = self.time + 0.5 * TICK_S
        if self._repeat_s <= now:  # no command came since the one that fired
            if self._repeat_s - self._commanded_s < self._watchdog:
                self._due.append(self._repeat_s)
            self._repeat_s += self._period
        while self._due and self._due[0] <= now:
            flight = self._robots.shoot(self._normals.standard_normal((1, 3)))
            plate = self._target.position(np.array([self.time]))
            command, is_hit = self._robots.truth().command, bool(np.linalg.norm(flight.miss) <= self._hit_radius)
            self._heat += _HEAT_OF_SHOT
            self.pellets.append(Pellet(self._due.pop(0), is_hit, command[0], flight.angle[0], plate[0], flight.miss[0]))

    @property
    def is_switch_on(self) -> bool:
        """Whether the operator's switch is on now."""
        return self._switch_at(self.time)

    @property
    def has_switch(self) -> bool:
        """Whether its reports have the operator's switch."""
        return bool(self._wire.tables[self._wire.report].switch_on)

    def _switch_at(self, time: float) -> bool:
        return any(begin <= time - self.trial_s < end for begin, end in self._switch_times)

    def _has(self, kind: str, time: float) -> bool:
        since = time - self.trial_s
        return any(fault.kind == kind and fault.begin_s <= since < fault.end_s for fault in self._faults)

    def _arrivals(self, received: Received) -> Iterator[Delivery]:
        """Yield frames and datagrams of messages, as faults leave them."""
        feedback, detections = received.feedback, received.detections
        for place in np.flatnonzero(~np.isnan(feedback.received_s[0])):
            time = float(feedback.received_s[0, place])
            yield self._on_line(time, self._report(time, feedback.angle[0, place], feedback.rate[0, place]))
            if time >= self._referee_s:
                self._referee_s = time + _REFEREE_S
                for layout in self._of_referee:
                    yield Delivery(time, False, layout.encode(self._heat_report(time, layout)), -math.inf)
        for place in np.flatnonzero(~np.isnan(detections.received_s[0])):
            time = float(detections.received_s[0, place])
            stamp = float(detections.exposed_s[0, place]) + _CAMERA_CLOCK_S
            stamp += _OTHER_CLOCK_S * self._has("camera-clock", time)
            plates = detections.position[0, place][detections.found[0, place]].tolist()
            plates = [] if self._has("hidden", time) else plates
            plates = [[math.nan, 0.0, 0.0]] if self._has("nan-detections", time) else plates
            if not self._has("blind", time):
                yield Delivery(time, True, json.dumps({"stamp": stamp, "plates": plates}).encode())

    def _heat_report(self, time: float, layout: Layout) -> dict[str, float]:
        values = {"shots_left": self._shots_left(time), "sequence": float(round(time / _REFEREE_S) % 256)}
        return {field: value for field, value in values.items() if field in layout.names}

    def _shots_left(self, time: float) -> float:
        """Return the shots that the heat limit allows, and let the barrel cool."""
        self._heat = max(0.0, self._heat - _COOLING * (time - self._cooled_s))
        self._cooled_s = time
        return max(0.0, math.floor((_HEAT_LIMIT - self._heat) / _HEAT_OF_SHOT))

    def _report(self, time: float, angle: Numbers, rate: Numbers) -> dict[str, float]:
        """Return the values of a report."""
        (pitch, yaw), (pitch_rate, yaw_rate) = angle.tolist(), rate.tolist()
        values = {"pitch": pitch, "yaw": yaw, "pitch_rate": pitch_rate, "yaw_rate": yaw_rate}
        values |= {"pitch_encoder": pitch, "yaw_encoder": yaw}  # the chassis stands
        values |= {"sequence": round(1e3 * time) % 256, "shots": len(self.pellets) % 256}
        values |= {"shots_left": self._shots_left(time)}
        is_on = self._switch_at(time)
        switch_on = self._wire.tables[self._wire.report].switch_on
        return values | {field: number if is_on else float(not number) for field, number in switch_on.items()}

    def _on_line(self, time: float, values: dict[str, float]) -> Delivery:
        """Return a report as it arrives, and when; on a line nothing overtakes."""
        layout = self._wire.layouts[self._wire.report]
        values = {field: value for field, value in values.items() if field in layout.names}
        true = layout.encode(values)
        frame = layout.encode(values | {"yaw": math.nan}) if self._has("nan", time) else true
        if self._has("frozen", time):
            frame = self._last_frame or frame
        self._last_frame = frame
        for kind, damage in _DAMAGES.items():
            if self._has(kind, time):
                frame = damage(frame, self._rng)
        arrives = time + _LATE_S * self._has("late", time)
        if self._has("burst", time):
            ends = [fault.end_s + self.trial_s for fault in self._faults if fault.kind == "burst"]
            arrives = max(arrives, min(end for end in ends if time < end))
        if frame:
            self._line_free_s = arrives = max(arrives, self._line_free_s)
        return Delivery(arrives, False, frame, time if true in frame else -math.inf)


def _check_room(report: Layout, limits: LimitsRecord) -> None:
    """Refuse a report without room for the ends of the limits, which would end a run."""
    for axis, own in (("pitch", limits.pitch), ("yaw", limits.yaw)):
        low, high = own.ends if own.low is not None else (-math.pi, math.pi)
        rate = own.max_rate if own.max_rate < UNLIMITED else 0.0
        needed = {axis: (high, low), f"{axis}_encoder": (high, low), f"{axis}_rate": (rate, -rate)}
        for field, values in needed.items():
            for value in values if field in report.names else ():
                try:
                    report.encode({field: value})
                except InputError as error:
                    unit = "rad/s" if field.endswith("_rate") else "rad"
                    problem = f"field {field}: it has no room for {value:g} {unit}, which limits.json allows"
                    remedy = "give it a wider type or a larger scale, or narrow limits.json"
                    raise InputError(f"frame {report.name}: {problem}; {remedy}") from error


def _flipped(frame: bytes, bit: int) -> bytes:
    """Return a frame with one of its bits turned."""
    return (int.from_bytes(frame, "little") ^ 1 << bit).to_bytes(len(frame), "little")
