"""A robot's computer without its ports and its clock: bytes and datagrams in, bytes out.

What runs on the robot runs the same in virtual time, where every fault can be repeated.
"""

from collections import Counter
from typing import Any

import numpy as np

from archerfish.dynamics.command_limits import limit_command
from archerfish.dynamics.muzzle import direction
from archerfish.errors import InputError
from archerfish.messages import Detections, Feedback, Numbers
from archerfish.protocols import Barrel, Command, Controller
from archerfish.robot import Robot
from archerfish.runtime.detections import CameraFrame, camera_frames
from archerfish.task import Task
from archerfish.tracking.clock_offset import ClockOffset
from archerfish.tracking.detections import GUESS_AGE_S, GUESS_DISTANCE_M
from archerfish.tracking.host import Host, SeenPlate, new_host, seen_by, with_messages
from archerfish.wires import Stream, Wire
from archerfish.wires.stream import WireFrame
from archerfish.wires.wire import TableWire, WireCommand, WireReports, in_range

_UNLIMITED = 1e6  # shots, without a referee


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
    ) -> None:
        """Begin without messages.

        Args:
          controller: built for robot and task.
          robot: its records; the camera's latency is needed, that of the link is zero where it was not measured.
          task: decision period and command limit.
          wire: to the microcontroller.
          camera_m: where the camera is from the pivot, along the gimbal's axes [m].

        Raises:
          InputError: if the records have no latency of the camera, or the task limits commands by the target's place.
        """
        if task.command_limit == "los-2deg":
            raise InputError("command_limit los-2deg needs the target's true place, which no robot has; take gate")
        if isinstance(wire, TableWire):
            wire.check_complete()
        self.counts = Counter[str]()
        """Messages and decisions by what became of them."""
        self.switch = self._was_on = False
        """Whether the operator lets the computer aim; a wire that reports a switch sets it."""
        self.muzzle_speed = np.nan
        """Measured last [m/s]."""
        self._controller, self._wire, self._stream = controller, wire, Stream(wire.received)
        self._limits, self._period = robot.command_limits(task), task.period_s
        self._expected_speed = np.asarray(robot.muzzle_model().speed).reshape(1)
        self._camera_clock = ClockOffset(camera_latency(robot))
        self._feedback_latency = (robot.sensing.link.feedback_latency if robot.sensing else None) or 0.0
        self._robot_clock = ClockOffset(self._feedback_latency)
        self._camera = np.array(camera_m)
        self._last_bytes = dict[str, bytes]()
        self._reports, self._raw_yaw, self._shots_left = list[tuple[float, Numbers, Numbers]](), 0.0, _UNLIMITED
        self._frames = list[tuple[float, Numbers]]()
        self._plate_in_world: SeenPlate | None = None
        self._host: Host | None = None
        self._state: Any = None
        self._decided_s, self._command, self._rate = -np.inf, np.zeros((1, 2)), np.zeros((1, 2))

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
          data: whole lines.
        """
        frames = camera_frames(data)
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
        elapsed = now - self._decided_s
        measured = host.reports.angle[:, -1]
        if not (self.switch and self._was_on):  # the first command is where the gimbal is
            self._command, self._rate = np.clip(measured, self._limits.low, self._limits.high), 0.0 * measured
        if now - host.plate.exposed_s[0] > GUESS_AGE_S:
            self._state = None
        is_first = self._state is None
        barrel = Barrel(self._expected_speed, np.array([self._shots_left]))
        seen = seen_by(host, now, 0.0 if is_first else elapsed, self._command, barrel)
        if is_first:
            self._state = self._controller.reset(seen)
        self._state, asked = self._controller.step(self._state, seen)
        self._decided_s = now
        self.counts["decisions"] += 1
        angle, fire = self._gated(asked, elapsed)
        # The yaw of the wire may wrap, that of the reports does not.
        on_wire = angle - [0.0, measured[0, 1] - self._raw_yaw]
        return self._wire.encode(WireCommand(on_wire[0], self.switch, fire))

    def _gated(self, asked: Command, elapsed: float) -> tuple[Numbers, bool]:
        """Return the command that is sent, and whether it fires: with the limits alone, and on request."""
        wanted = np.asarray(asked.angle, np.float64)
        was_on, self._was_on = self._was_on, self.switch
        if not (self.switch and was_on and np.all(np.isfinite(wanted))):
            return self._command, False
        # Where a decision was missed the command has stood still since.
        rate = self._rate if elapsed < 1.5 * self._period else 0.0 * self._rate
        away = np.zeros((1, 2))
        angle = np.asarray(limit_command(self._limits, wanted, self._command, rate, away, np.asarray(self._period)))
        self._command, self._rate = angle, (angle - self._command) / self._period
        return angle, bool(np.asarray(asked.fire).all())

    def _is_new(self, frame: WireFrame) -> bool:
        """Whether a frame differs from the last one of its kind: one that a line repeats is no news."""
        last = self._last_bytes.get(frame.layout.name)
        self._last_bytes[frame.layout.name] = frame.data
        return frame.data != last

    def _take_reports(self, now: float, reports: WireReports) -> None:
        """Keep the reports that a gimbal may give, with their times on the computer's clock."""
        if reports.switch_on is not None and len(reports.switch_on):
            self.switch = bool(reports.switch_on[-1])
        feedback = reports.feedback
        usable = in_range(feedback)
        self.counts["reports out of range"] += int(np.sum(~usable))
        for place in np.flatnonzero(usable):
            stamp = feedback.sampled_s[place]
            sampled = now - self._feedback_latency if np.isnan(stamp) else self._robot_clock.own_time(stamp, now)
            self._reports.append((sampled, feedback.angle[place], feedback.rate[place]))
            self._raw_yaw = float(feedback.angle[place, 1])
            self.muzzle_speed = float(reports.muzzle_speed[place])
            if np.isfinite(reports.shots_left[place]):
                self._shots_left = float(reports.shots_left[place])

    def _take_plate(self, exposed: float, frame: CameraFrame) -> None:
        """Keep the first plate of a frame: of the gimbal's frame until a report covers it, as it is in O."""
        place = np.array(frame.plates[0])
        if frame.frame == "world":
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
        self._reports, self._frames, self._plate_in_world = [], [], None
        return self._host


def camera_latency(robot: Robot) -> float:
    """Return the mean time from an exposure to the receipt of its detections [s].

    Raises:
      InputError: if the robot's records don't have it.
    """
    latency = robot.sensing.camera.latency if robot.sensing else None
    if latency is None:
        remedy = "record timing_plate.csv with the times of receipt, and identify again"
        raise InputError(f"{robot.name} has no latency of its camera, so no detection can be dated; {remedy}")
    return latency
