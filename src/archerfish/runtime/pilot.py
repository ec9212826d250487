"""A robot's computer without its ports and its clock: bytes and datagrams in, bytes out.

What runs on the robot runs the same in virtual time, where every fault can be repeated.
"""

from collections import Counter, deque
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from archerfish.dynamics.linear_axis import advance
from archerfish.dynamics.muzzle import direction
from archerfish.messages import Detections, Feedback, Numbers
from archerfish.robot import Robot
from archerfish.runtime.configuration import camera_latency
from archerfish.runtime.deciders import Decider, WithFallback, error_text
from archerfish.runtime.detections import CameraFrame, camera_frames
from archerfish.safety.gate import GateState, GateVerdict, Mode, Reason
from archerfish.safety.plausibility import (
    Prediction,
    compare_with_prediction,
    resting_prediction,
    thresholds,
)
from archerfish.safety.rules import LOST_S, STALE_S
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.tracking.detections import GUESS_DISTANCE_M
from archerfish.tracking.host import Host, SeenPlate, new_host, with_messages
from archerfish.wires import Stream, Wire
from archerfish.wires.stream import WireFrame
from archerfish.wires.wire import TableWire, WireCommand, WireReports, check_shapes, in_range

_UNLIMITED = 1e6  # shots, without a referee
_MOST = 512  # messages between decisions; of more, the oldest are lost
_LONGEST_DATAGRAM = 4096  # bytes
_NEAREST_M = 0.1  # a plate that is nearer is none
_JUMP_RAD, _FASTEST = 0.3, 30.0  # between reports a gimbal moves at most by [rad], and so much a second [rad/s]
_JUMPING_S = 0.02  # for so long reports that move by more are left out
_HEAT_DELAY_S = 0.1  # a shot since then is not yet in a report of heat
_MOST_PREDICTED = 50  # periods without a decision that the prediction goes on through


class _Before(NamedTuple):
    """What a decision changed, for the case that its command is not sent."""

    gate: GateState
    sent_s: float  # when a command was sent last
    is_controlled: bool  # whether that before was a command, or let the gimbal go


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
          robot: its records, with the limits that its gate has. They need the camera's latency; that of the link is
            zero where it was not measured.
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
        self._decode_error, self._encode_error = "", ""
        self.muzzle_speed = np.nan
        """Measured last [m/s]."""
        self.decider = decider
        """What decides."""
        self._wire, self._period = wire, task.period_s
        self._expected_speed = float(robot.muzzle_model().speed)
        self._latency = camera_latency(robot) if latency_s is None else latency_s
        self._feedback_latency = (robot.sensing.link.feedback_latency if robot.sensing else None) or 0.0
        self._camera, self._middle_yaw = np.array(camera_m), float(np.mean(robot.limits.yaw.ends))
        self._needs_base = robot.limits.yaw.low is not None and getattr(wire, "has_base_yaw", False)
        self._gimbal, self._thresholds = robot.gimbal(task.period_s), thresholds(robot)
        self.restart()

    def restart(self) -> None:
        """Forget all that was received, as where the port has gone and come back; the gate is disarmed."""
        self.switch, self._stream = False, Stream(self._wire.received)
        self._camera_clock, self._robot_clock = ClockOffset(self._latency), ClockOffset(self._feedback_latency)
        self._last_bytes, self._received = dict[str, bytes](), 0
        self._reports = deque[tuple[float, Numbers, Numbers]](maxlen=_MOST)
        self._frames = deque[tuple[float, Numbers]](maxlen=_MOST)
        self._allowed = 0.0 if getattr(self._wire, "has_heat", False) else _UNLIMITED  # shots, when heat was reported
        self._plate_in_world: SeenPlate | None = None
        self._host: Host | None = None
        self.decider.reset()
        self._decided_s = -np.inf
        self.verdict = None
        self._before: _Before | None = None  # the last decision, until that is taken back
        self._sent_s, self._is_controlled = -np.inf, False  # when a command was sent last, and whether the last one was
        self._fired_s = list[float]()  # since the latest report of heat
        self._last_report: tuple[float, Numbers] | None = None
        self._jump_s = np.inf  # when the first of the latest reports was left out as a jump
        self._prediction: Prediction | None = None
        self._raw_yaw = 0.0
        self._raw_base_yaw = np.nan
        if hasattr(self._wire, "restart"):
            self._wire.restart()

    def on_bytes(self, now: float, data: bytes) -> None:
        """Take bytes that the microcontroller sent.

        Args:
          now: when they were received [s].
          data: any part of its stream.
        """
        self._received += len(data)
        frames = self._stream.feed(data)
        new = [frame for frame in frames if self._is_new(frame)]
        self.counts["frames"] += len(new)
        self.counts["repeated frames"] += len(frames) - len(new)
        self.counts["rejected heads"] = self._stream.rejected
        if new:
            self._take_frames(now, new)

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
        before, elapsed = self._gate_now(now, host), self._elapsed(now)
        self.verdict, _ = self.decider.decide(self._given(now, elapsed, host, before))
        self._before = _Before(before, self._sent_s, self._is_controlled)
        self._decided_s, is_fired = now, bool(self.verdict.fire)
        self._fired_s += [now] * (is_fired and self._allowed < _UNLIMITED)
        # After a pause without commands the gimbal is let go until a report says where it is.
        is_known = now - self._sent_s <= LOST_S or now - host.reports.sampled_s[0, -1] <= STALE_S
        is_commanding = self.switch and int(self.verdict.mode) != Mode.DISARMED
        self._is_controlled = is_commanding and bool(before.mode == Mode.DISARMED or is_known)
        self._sent_s = now if self._is_controlled else self._sent_s
        frame = self._encoded(self.verdict.angle, self._is_controlled, is_fired)
        reason = Reason(int(self.verdict.reason))
        if frame is not None:
            self.counts[f"not fired: {reason.text}" if reason else "fired"] += 1
            return frame
        self.counts["commands that the wire can't carry"] += 1
        self.withdraw()
        self._is_controlled = False
        return self._encoded(self.verdict.angle, False, False) or b""

    def withdraw(self) -> None:
        """Take the last command back, which was not sent: limits count from what was, at rest.

        Mode and timers go on. The controller keeps what it has seen, and the prediction what was in force.
        """
        if self._before is None or self.verdict is None:
            return
        before, after = self._before.gate, self.decider.gate
        kept = after._replace(command=before.command, rate=np.zeros_like(after.rate))
        if self.verdict.fire:
            kept = kept._replace(since_shot=before.since_shot + np.float32(self._period))
            self._fired_s = [fired for fired in self._fired_s if fired != self._decided_s]
            self.counts["fired"] -= 1
            self.counts["not fired: not sent"] += 1
        self.decider.gate = kept
        self._sent_s, self._is_controlled = self._before.sent_s, self._before.is_controlled
        self._before = None

    def last_frame(self) -> bytes:
        """Return bytes that end the fire and let the gimbal go; nothing before the first report. It never fails."""
        if self._host is None or self.verdict is None:
            return b""
        command = self.decider.gate.command
        is_controlled = self.switch and int(self.verdict.mode) != Mode.DISARMED
        held = self._encoded(command, True, False) if is_controlled else b""
        return (held or b"") + (self._encoded(command, False, False) or b"")

    @property
    def state_text(self) -> str:
        """What the gate does, and why it is not armed."""
        wire_error = self._decode_error or self._encode_error
        raised = f"; the wire raised {wire_error}" if wire_error else ""
        if self.verdict is None:
            among = "frames, but no report that can be used" if self._last_bytes else "no frame of the wire"
            received = f" ({self._received} bytes came, among them {among})" if self._received else ""
            return f"waiting for the first report{received}{raised}"
        mode, cause = Mode(int(self.verdict.mode)), Reason(int(self.verdict.cause))
        state = f"{mode.name.lower()}: {cause.text}" if cause else mode.name.lower()
        if cause == Reason.FEEDBACK_OLD and self.counts["repeated frames"] > self.counts["frames"]:
            state += "; reports repeat byte for byte, which is no news: their frame needs a counter or a time"
        state += raised
        why = self.decider.why_fallback if isinstance(self.decider, WithFallback) else ""
        state += f"; the fallback decides: {why}" if why else ""
        return f"{state}; raised: {self.decider.error}" if self.decider.error else state

    def _gate_now(self, now: float, host: Host) -> GateState:
        """Return the gate's state; where commands have not been sent for long, a fault that begins at the gimbal."""
        gate = self.decider.gate
        if gate.mode != Mode.DISARMED and now - self._sent_s > LOST_S:
            angle = np.float32(host.reports.angle[0, -1])
            cause = gate.cause if gate.mode == Mode.FAULT else np.float32(Reason.DECISION_LATE)
            fault = np.float32(Mode.FAULT)
            gate = gate._replace(mode=fault, cause=cause, command=angle, rate=np.zeros_like(gate.rate))
            self.decider.gate = gate
        return gate

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
            "base_yaw": self._base_yaw(reports.angle[0, -1, 1], gate),
            "shots_left": self._allowed - len(self._fired_s),
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
        is_sent = np.asarray(self._is_controlled and gate.mode != Mode.DISARMED)
        self._prediction, plausible = compare_with_prediction(
            self._gimbal, self._thresholds, past, gate.command, is_sent, angle, age
        )
        return np.asarray(plausible)

    def _base_yaw(self, yaw: float, gate: GateState) -> float:
        """Return the yaw of the chassis, 0 where the yaw has no range, or the wire has a yaw from the chassis alone.

        While disarmed, the encoder's is less than half a turn from the middle of its range; then it goes on from there.

        Args:
          yaw: of the gimbal, without jumps of a turn [rad].
          gate: its state.
        """
        if not self._needs_base:
            return 0.0
        near = yaw - self._middle_yaw if gate.mode == Mode.DISARMED else float(gate.base_yaw)
        return float(near + (self._raw_base_yaw - near + np.pi) % (2.0 * np.pi) - np.pi)

    def _encoded(self, angle: Numbers, control: bool, fire: bool) -> bytes | None:
        """Return the frame of a command, or None where the wire can't carry it.

        Its yaw is in the turn of the last report, or a turn from there where the wire's range ends.
        """
        yaw = float(self._host.reports.angle[0, -1, 1]) if self._host is not None else 0.0
        turns = np.rint((yaw - self._raw_yaw) / (2.0 * np.pi))
        for more in (0.0, 1.0, -1.0):
            on_wire = np.asarray(angle, np.float64) - [0.0, 2.0 * np.pi * (turns + more)]
            try:
                frame = self._wire.encode(WireCommand(on_wire, control, fire))
            except Exception as error:
                self._encode_error = error_text(error)  # whatever a team's own wire raises
            else:
                self._encode_error = ""
                return frame
        return None

    def _is_new(self, frame: WireFrame) -> bool:
        """Whether a frame differs from the last one of its kind: one that a line repeats is no news."""
        last = self._last_bytes.get(frame.layout.name)
        self._last_bytes[frame.layout.name] = frame.data
        return frame.data != last

    def _take_frames(self, now: float, frames: Sequence[WireFrame]) -> None:
        """Decode frames; where a team's own wire raises, one by one, so that a bad one costs no other."""
        try:
            reports = self._wire.decode(frames)
            check_shapes(reports)
            self._take_reports(now, reports)
            self._decode_error = ""
        except Exception as error:
            if len(frames) > 1:
                for frame in frames:
                    self._take_frames(now, [frame])
                return
            self.counts["frames that the wire can't decode"] += 1
            self._decode_error = error_text(error)

    def _take_reports(self, now: float, reports: WireReports) -> None:
        """Keep the reports that a gimbal may give, with their times on the computer's clock."""
        if reports.switch_on is not None and len(reports.switch_on):
            self.has_switch, self.switch = True, bool(reports.switch_on[-1])
        feedback = reports.feedback
        usable = in_range(feedback)
        self.counts["reports out of range"] += int(np.sum(~usable))
        for place in np.flatnonzero(usable):
            angle, stamp = feedback.angle[place], feedback.sampled_s[place]
            sampled = now - self._feedback_latency if np.isnan(stamp) else self._robot_clock.own_time(stamp, now)
            if not np.isfinite(sampled) or self._is_jump(now, sampled, angle):
                continue
            self._reports.append((sampled, angle, feedback.rate[place]))
            self._raw_yaw, self._raw_base_yaw = float(angle[1]), float(reports.base_yaw[place])
            self.muzzle_speed = float(reports.muzzle_speed[place])
            if np.isfinite(reports.shots_left[place]):
                self._allowed = float(reports.shots_left[place])
                self._fired_s = [fired for fired in self._fired_s if now - fired <= _HEAT_DELAY_S]

    def _is_jump(self, now: float, sampled: float, angle: Numbers) -> bool:
        """Return whether a report is further from the last one than a gimbal turns; after some time it is taken."""
        before, self._last_report = self._last_report, (sampled, angle)
        if before is None:
            return False
        moved = np.abs(angle - before[1])
        moved[1] = min(moved[1], abs(moved[1] - 2.0 * np.pi))  # a yaw that wraps
        is_near = np.all(moved <= _JUMP_RAD + _FASTEST * max(0.0, sampled - before[0]))
        if is_near or now - self._jump_s > _JUMPING_S:
            self._jump_s = np.inf
            return False
        self._jump_s, self._last_report = min(self._jump_s, now), before
        self.counts["reports that jump"] += 1
        return True

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
