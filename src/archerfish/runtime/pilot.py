"""A robot's computer without its ports and its clock: bytes and datagrams in, bytes out.

What runs on the robot runs the same in virtual time, where every fault can be repeated.
"""

from collections import Counter, deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.linear_axis import advance
from archerfish.dynamics.muzzle import direction
from archerfish.errors import InputError
from archerfish.messages import Detections, Feedback, Numbers
from archerfish.robot import Robot
from archerfish.runtime.configuration import camera_latency
from archerfish.runtime.deciders import Decider, WithFallback
from archerfish.runtime.detections import CameraFrame, camera_frames
from archerfish.safety.gate import GateState, GateVerdict, Mode, Reason
from archerfish.safety.plausibility import (
    Prediction,
    compare_with_prediction,
    resting_prediction,
    thresholds,
)
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.tracking.detections import GUESS_DISTANCE_M
from archerfish.tracking.host import Host, SeenPlate, new_host, with_messages
from archerfish.wires import Stream, Wire
from archerfish.wires.stream import WireFrame
from archerfish.wires.wire import TableWire, WireCommand, WireReports, in_range

_UNLIMITED = 1e6  # shots, without a referee
_MOST = 512  # messages between decisions; of more, the oldest are lost
_LONGEST_DATAGRAM = 4096  # bytes
_NEAREST_M = 0.1  # a plate that is nearer is none
_MOST_PREDICTED = 50  # periods without a decision that the prediction goes on through


class Pilot:
    """Decides for one robot; times are those of the computer's clock [s], which never runs back."""

    def __init__(
        self,
        decider: Decider,
        robot: Robot,
        task: Task,
        wire: Wire,
        *,
        camera_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
        latency_s: float | None = None,
    ) -> None:
        """Begin without messages.

        Args:
          decider: built for robot and task.
          robot: its records; the camera's latency is needed, that of the link is zero where it was not measured.
          task: decision period and command limit.
          wire: to the microcontroller.
          camera_m: where the camera is from the pivot, along the gimbal's axes [m].
          latency_s: mean time from an exposure to the receipt of its detections; that of the records if not given [s].

        Raises:
          InputError: if the records have no latency of the camera.
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
        self.decider = decider
        """What decides."""
        self._wire, self._period = wire, task.period_s
        self._expected_speed = float(robot.muzzle_model().speed)
        self._latency = camera_latency(robot) if latency_s is None else latency_s
        self._feedback_latency = (robot.sensing.link.feedback_latency if robot.sensing else None) or 0.0
        self._camera, self._middle_yaw = np.array(camera_m), float(np.mean(robot.limits.yaw.ends))
        self._gimbal, self._thresholds = robot.gimbal(task.period_s), thresholds(robot)
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
        self.decider.reset()
        self._decided_s = -np.inf
        self._gate_before: GateState | None = None  # the last decision, until that is taken back
        self._prediction: Prediction | None = None
        self._raw_yaw = 0.0
        # Of the chassis, without jumps of a turn; a wire that reports it must have done so [rad].
        self._base_yaw = np.nan if getattr(self._wire, "has_base_yaw", False) else 0.0

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
        self.counts["decisions"] += 1
        gate_before, elapsed = self.decider.gate, self._elapsed(now)
        given = self._given(now, elapsed, host, gate_before)
        self.verdict, _ = self.decider.decide(given)
        self._decided_s, self._gate_before = now, gate_before
        self._shots_left -= float(self.verdict.fire)
        reason = Reason(int(self.verdict.reason))
        self.counts[f"not fired: {reason.text}" if reason else "fired"] += 1
        is_controlled = self.switch and int(self.verdict.mode) != Mode.DISARMED
        return self._encoded(self.verdict.angle, is_controlled, bool(self.verdict.fire))

    def withdraw(self) -> None:
        """Take the last decision back: its command was not sent, and limits count from what was.

        The controller keeps what it has seen, and the prediction of the gimbal what has been in force till then.
        """
        if self._gate_before is not None and self.verdict is not None:
            self._shots_left += float(self.verdict.fire)
            self.decider.gate, self._gate_before = self._gate_before, None

    def last_frame(self) -> bytes:
        """Return bytes that end the fire and let the gimbal go; nothing before the first report. It never fails."""
        if self._host is None or self.verdict is None:
            return b""
        command = self.decider.gate.command
        is_controlled = self.switch and int(self.verdict.mode) != Mode.DISARMED
        held = self._encoded(command, True, False) if is_controlled else b""
        return held + self._encoded(command, False, False)

    @property
    def state_text(self) -> str:
        """What the gate does, and why it is not armed."""
        if self.verdict is None:
            return "waiting for the first report"
        mode, cause = Mode(int(self.verdict.mode)), Reason(int(self.verdict.cause))
        state = f"{mode.name.lower()}: {cause.text}" if cause else mode.name.lower()
        why = self.decider.why_fallback if isinstance(self.decider, WithFallback) else ""
        return f"{state}; the fallback decides: {why}" if why else state

    def _elapsed(self, now: float) -> float:
        """Return the time since the last decision, a period before the first one [s]."""
        return now - self._decided_s if np.isfinite(self._decided_s) else self._period

    def _given(self, now: float, elapsed: float, host: Host, gate: GateState) -> dict[str, Any]:
        """Return what a decision gets: `codegen.decision.FIELDS`, in float32."""
        reports, plate, is_new = host.reports, host.plate, bool(host.plate.is_new[0])
        age = now - reports.sampled_s[0, -1]
        numbers = {
            "elapsed": elapsed,
            "gimbal_age": age,
            "frame_age": now - plate.exposed_s[0] if is_new else 0.0,
            "muzzle_speed": self._expected_speed,
            "base_yaw": self._base_yaw,
            "shots_left": self._shots_left,
            "angle": reports.angle[0, -1],
            "rate": reports.rate[0],
            "plate": plate.position[0] if is_new else np.zeros(3),
        }
        given: dict[str, Any] = {name: np.asarray(number, np.float32) for name, number in numbers.items()}
        distrusted = ~self._plausible(elapsed, gate, given["angle"], given["gimbal_age"])
        return given | {"found": np.asarray(is_new), "switch_on": np.asarray(self.switch), "distrusted": distrusted}

    def _plausible(self, elapsed: float, gate: GateState, angle: Numbers, age: Numbers) -> NDArray[np.bool_]:
        """Return whether the feedback is what the plant does with the commands in force, shape ()."""
        past = self._prediction or resting_prediction(self._gimbal, angle)
        for _ in range(min(round(elapsed / self._period), _MOST_PREDICTED) - 1):  # decisions that were left out
            past = past._replace(plant=advance(self._gimbal, past.plant, gate.command))
        is_sent = np.asarray(gate.mode != Mode.DISARMED)
        self._prediction, plausible = compare_with_prediction(
            self._gimbal, self._thresholds, past, gate.command, is_sent, angle, age
        )
        return np.asarray(plausible)

    def _encoded(self, angle: Numbers, control: bool, fire: bool) -> bytes:
        """Return the frame of a command, whose yaw is in the turn of the last report.

        Where the wire has no room for it, the gimbal is let go.
        """
        yaw = float(self._host.reports.angle[0, -1, 1]) if self._host is not None else 0.0
        turns = np.rint((yaw - self._raw_yaw) / (2.0 * np.pi))
        on_wire = np.asarray(angle, np.float64) - [0.0, 2.0 * np.pi * turns]
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
            base_yaw = float(reports.base_yaw[place])
            if np.isfinite(base_yaw):
                # At first the encoder's yaw is taken as less than half a turn from the middle of its range.
                near = self._base_yaw if np.isfinite(self._base_yaw) else self._raw_yaw - self._middle_yaw
                self._base_yaw = near + (base_yaw - near + np.pi) % (2.0 * np.pi) - np.pi
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
