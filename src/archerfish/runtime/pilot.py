"""A robot's computer without its ports and its clock: bytes and datagrams in, bytes out.

What runs on the robot runs the same in virtual time, where every fault can be repeated.
"""

from collections import Counter, deque
from typing import Any

import numpy as np

from archerfish.arrays import single_precision
from archerfish.dynamics.muzzle import direction
from archerfish.errors import InputError
from archerfish.messages import Detections, Feedback, Numbers
from archerfish.protocols import Barrel, Command, Controller
from archerfish.robot import Robot
from archerfish.runtime.configuration import camera_latency
from archerfish.runtime.detections import CameraFrame, camera_frames
from archerfish.safety.gate import GateInput, GateState, GateVerdict, Mode, Reason, gate, resting_gate
from archerfish.safety.plausibility import (
    THRESHOLD_RAD,
    Prediction,
    compare_with_prediction,
    resting_prediction,
)
from archerfish.safety.rules import GateConfig, gate_rules
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.tracking.detections import GUESS_AGE_S, GUESS_DISTANCE_M
from archerfish.tracking.host import Host, SeenPlate, new_host, seen_by, with_messages
from archerfish.wires import Stream, Wire
from archerfish.wires.stream import WireFrame
from archerfish.wires.wire import TableWire, WireCommand, WireReports, in_range

_UNLIMITED = 1e6  # shots, without a referee
_MOST = 512  # messages between decisions; of more, the oldest are lost
_LONGEST_DATAGRAM = 4096  # bytes
_NEAREST_M = 0.1  # a plate that is nearer is none


class Pilot:
    """Decides for one robot; times are those of the computer's clock [s], which never runs back."""

    def __init__(
        self,
        controller: Controller,
        robot: Robot,
        task: Task,
        wire: Wire,
        *,
        camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        latency_s: float | None = None,
        config: GateConfig | None = None,
    ) -> None:
        """Begin without messages.

        Args:
          controller: built for robot and task.
          robot: its records; the camera's latency is needed, that of the link is zero where it was not measured.
          task: decision period and command limit.
          wire: to the microcontroller.
          camera_m: where the camera is from the pivot, along the gimbal's axes [m].
          latency_s: mean time from an exposure to the receipt of its detections; that of the records if not given [s].
          config: what the gate allows less than the records.

        Raises:
          InputError: if the records have no latency of the camera, or the task limits commands by the target's place.
        """
        if isinstance(wire, TableWire):
            wire.check_complete()
        self.counts = Counter[str]()
        """Messages and decisions by what became of them."""
        self.has_switch = False
        """Whether the wire reports the operator's switch; where it doesn't, `switch` is set by the program."""
        self.switch = False
        """Whether the operator lets the computer aim; a wire that reports a switch sets it."""
        self.verdict: GateVerdict | None = None
        """The last one of the gate."""
        self.muzzle_speed = np.nan
        """Measured last [m/s]."""
        self._controller, self._wire = controller, wire
        self._rules, self._period = gate_rules(robot, task, config), task.period_s
        self._expected_speed = np.asarray(robot.muzzle_model().speed).reshape(1)
        self._latency = camera_latency(robot) if latency_s is None else latency_s
        self._feedback_latency = (robot.sensing.link.feedback_latency if robot.sensing else None) or 0.0
        self._camera, self._gimbal = np.array(camera_m), robot.gimbal(task.period_s)
        self.restart()

    def restart(self) -> None:
        """Forget all that was received, as where the port has gone and come back; the gate is disarmed."""
        self.switch, self._stream = False, Stream(self._wire.received)
        self._camera_clock, self._robot_clock = ClockOffset(self._latency), ClockOffset(self._feedback_latency)
        self._last_bytes = dict[str, bytes]()
        self._reports = deque[tuple[float, Numbers, Numbers]](maxlen=_MOST)
        self._frames = deque[tuple[float, Numbers]](maxlen=_MOST)
        self._shots_left = 0.0 if getattr(self._wire, "has_heat", False) else _UNLIMITED
        self._reported_shots_left = np.nan
        self._plate_in_world: SeenPlate | None = None
        self._host: Host | None = None
        self._state: Any = None
        self._decided_s, self._gated_s = -np.inf, -np.inf
        self._gate: GateState | None = None
        self._gate_before: tuple[float, GateState | None] = -np.inf, None  # the last decision
        self._prediction: Prediction | None = None
        self._raw_yaw = 0.0

    def on_bytes(self, now: float, data: bytes) -> None:
        """Take bytes that the microcontroller sent.

        Args:
          now: when they were received [s].
          data: any part of its stream.
        """
        frames = self._stream.feed(data)
        new = [frame for frame in frames if self._is_new(frame)]
        self.counts["frames"] += len(new)
        self.counts["repeated frames"] += len(frames) - len(new)
        self.counts["rejected heads"] = self._stream.rejected
        if new:
            self._take_reports(now, self._wire.decode(new))

    def on_datagram(self, now: float, data: bytes) -> None:
        """Take detections, lines of JSON as `CameraFrame` describes them.

        Args:
          now: when they were received [s].
          data: whole lines, of up to 4 KB in all.
        """
        frames = camera_frames(data) if len(data) <= _LONGEST_DATAGRAM else None
        self.counts["datagrams" if frames is not None else "refused datagrams"] += 1
        for frame in frames or ():
            exposed = self._camera_clock.own_time(frame.stamp, now)
            if frame.plates and np.isfinite(exposed):
                self._take_plate(exposed, frame)

    def tick(self, now: float) -> bytes:
        """Decide, and return the bytes to send; none before the first report.

        Args:
          now: present time, a decision period after the last tick [s].
        """
        host = self._with_messages(now)
        if host is None:
            return b""
        measured = single_precision(host.reports.angle[:, -1])
        state = resting_gate(measured) if self._gate is None else self._gate
        self.counts["decisions"] += 1
        verdict = self._through_gate(now, host, state, self._asked(now, host, state.command))
        is_controlled = self.switch and bool(verdict.mode[0] != Mode.DISARMED)
        return self._encoded(verdict.angle, is_controlled, bool(verdict.fire[0]))

    def _asked(self, now: float, host: Host, command: Numbers) -> Command:
        """Return what the controller asks for; without a plate of late, the command in force, and no shot."""
        if now - host.plate.exposed_s[0] > GUESS_AGE_S:
            self._state = None
            return Command(command, np.zeros_like(command), np.zeros(1, bool), np.full(1, np.nan))
        is_first = self._state is None
        barrel = Barrel(self._expected_speed, np.array([self._shots_left]))
        seen = seen_by(host, now, 0.0 if is_first else now - self._decided_s, command, barrel)
        if is_first:
            self._state = self._controller.reset(seen)
        self._state, asked = self._controller.step(self._state, seen)
        self._decided_s = now
        if not np.all(np.isfinite(np.asarray(asked.angle))):  # its memory may hold no numbers any more
            self._state = None
        return asked

    def withdraw(self) -> None:
        """Forget that the last command was sent: it was not, and limits count from what was."""
        self._gated_s, self._gate = self._gate_before

    def last_frame(self) -> bytes:
        """Return bytes that end the fire and let the gimbal go; nothing before the first report. It never fails."""
        if self._gate is None or self.verdict is None:
            return b""
        is_controlled = self.switch and bool(self.verdict.mode[0] != Mode.DISARMED)
        held = self._encoded(self._gate.command, True, False) if is_controlled else b""
        return held + self._encoded(self._gate.command, False, False)

    @property
    def state_text(self) -> str:
        """What the gate does, and why it is not armed."""
        if self.verdict is None:
            return "waiting for the first report"
        mode, cause = Mode(int(self.verdict.mode[0])), Reason(int(self.verdict.cause[0]))
        state = f"{mode.name.lower()}: {cause.text}" if cause else mode.name.lower()
        fault = getattr(self._controller, "fault", "")
        return f"{state}; the fallback decides: {fault}" if fault else state

    def _through_gate(self, now: float, host: Host, state: GateState, asked: Command) -> GateVerdict:
        """Return what is sent of what a controller asks for."""
        angle, age = single_precision((host.reports.angle[:, -1], now - host.reports.sampled_s[:, -1]))
        is_sent = state.mode != Mode.DISARMED
        past = self._prediction or resting_prediction(self._gimbal, angle)
        self._prediction, plausible = compare_with_prediction(
            self._gimbal, np.float32(THRESHOLD_RAD), past, state.command, is_sent, angle, age
        )
        given = GateInput(
            elapsed=np.array([now - self._gated_s if np.isfinite(self._gated_s) else self._period]),
            desired=np.asarray(asked.angle),
            fire=np.asarray(asked.fire, bool),
            switch_on=np.array([self.switch]),
            angle=angle,
            feedback_age=age,
            plate_age=now - host.plate.exposed_s,
            base_yaw=np.zeros(1),
            shots_left=np.array([self._shots_left]),
            plausible=plausible,
        )
        self._gate_before = self._gated_s, state
        self._gate, self.verdict = gate(self._rules, state, single_precision(given))
        self._gated_s = now
        self._shots_left -= float(self.verdict.fire[0])
        reason = Reason(int(self.verdict.reason[0]))
        self.counts[f"not fired: {reason.text}" if reason else "fired"] += 1
        return self.verdict

    def _encoded(self, angle: Numbers, control: bool, fire: bool) -> bytes:
        """Return the frame of a command, whose yaw is in the turn of the last report.

        Where the wire has no room for it, the gimbal is let go.
        """
        yaw = float(self._host.reports.angle[0, -1, 1]) if self._host is not None else 0.0
        turns = np.rint((yaw - self._raw_yaw) / (2.0 * np.pi))
        on_wire = angle[0].astype(np.float64) - [0.0, 2.0 * np.pi * turns]
        try:
            return self._wire.encode(WireCommand(on_wire, control, fire))
        except InputError:
            self.counts["commands beyond the wire's range"] += 1
        try:
            return self._wire.encode(WireCommand(np.zeros(2), False, False))
        except InputError:
            return b""

    def _is_new(self, frame: WireFrame) -> bool:
        """Whether a frame differs from the last one of its kind: one that a line repeats is no news."""
        last = self._last_bytes.get(frame.layout.name)
        self._last_bytes[frame.layout.name] = frame.data
        return frame.data != last

    def _take_reports(self, now: float, reports: WireReports) -> None:
        """Keep the reports that a gimbal may give, with their times on the computer's clock."""
        if reports.switch_on is not None and len(reports.switch_on):
            self.has_switch, self.switch = True, bool(reports.switch_on[-1])
        feedback = reports.feedback
        usable = in_range(feedback)
        self.counts["reports out of range"] += int(np.sum(~usable))
        for place in np.flatnonzero(usable):
            stamp = feedback.sampled_s[place]
            sampled = now - self._feedback_latency if np.isnan(stamp) else self._robot_clock.own_time(stamp, now)
            if not np.isfinite(sampled):
                continue
            self._reports.append((sampled, feedback.angle[place], feedback.rate[place]))
            self._raw_yaw = float(feedback.angle[place, 1])
            self.muzzle_speed = float(reports.muzzle_speed[place])
            shots_left = float(reports.shots_left[place])
            # The latest heat stands in each report: only another one is news, and shots of since count.
            if np.isfinite(shots_left) and shots_left != self._reported_shots_left:
                self._shots_left = self._reported_shots_left = shots_left

    def _take_plate(self, exposed: float, frame: CameraFrame) -> None:
        """Keep the first plate of a frame: of the gimbal's frame until a report covers it, as it is in O."""
        place = np.array(frame.plates[0])
        if np.linalg.norm(place) < _NEAREST_M:
            self.counts["plates too near"] += 1
        elif frame.frame == "world":
            latest = self._plate_in_world or (self._host.plate if self._host else None)
            if latest is not None and exposed <= latest.exposed_s[0]:
                return
            self._plate_in_world = SeenPlate(place[None], np.array([exposed]), np.array([True]))
        else:
            self._frames.append((exposed, place + (self._camera if frame.frame == "camera" else 0.0)))

    def _with_messages(self, now: float) -> Host | None:
        """Return the memory with all that was received since the last decision; None before the first report."""
        reports, frames = self._reports, self._frames
        if self._host is None:
            if not reports:
                return None
            self._host = new_host(GUESS_DISTANCE_M * direction(reports[-1][1][None]))
        times = np.array([[report[0] for report in reports]]).reshape(1, -1)
        angles = np.array([report[1] for report in reports]).reshape(1, -1, 2)
        rates = np.array([report[2] for report in reports]).reshape(1, -1, 2)
        exposed = np.array([frame[0] for frame in frames]).reshape(1, -1)
        places = np.array([frame[1] for frame in frames]).reshape(1, -1, 1, 3)
        found = np.ones((*exposed.shape, 1), bool)
        detections = Detections(exposed, exposed, found, places)
        self._host = with_messages(self._host, Feedback(times, times, angles, rates), detections, 0.0, now)
        if self._plate_in_world is not None:
            self._host = self._host._replace(plate=self._plate_in_world)
        self._reports.clear()
        self._frames.clear()
        self._plate_in_world = None
        return self._host
