"""What a rehearsal counted: its record, its report, and the figures of its page."""

import contextlib
import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from msgspec import Meta

from archerfish.errors import InputError
from archerfish.evaluation.hit_rate import HitRate, hit_rate
from archerfish.provenance import code_commit
from archerfish.records.record import Record, Text
from archerfish.reports.report import Report
from archerfish.reports.style import INK, MUTED, PALETTE, Figure, look, new_figure, plot_style
from archerfish.reports.table import Estimate, Table, entry_texts
from archerfish.robot import Robot
from archerfish.runtime.configuration import FILE, DeployConfig, camera_latency
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.emulator import Fault, Pellet
from archerfish.virtual_robot.identified import IDENTIFIED

COUNTED_FROM_S = 1.5
"""Hits count from here on: the operator's switch goes on after 1 s [s]."""
_Count = Annotated[int, Meta(ge=0, le=1_000_000_000)]
_FEWEST = 10  # seconds' worth of pellets for an interval
_LARGEST_RATIO = 2.0  # of two latencies of a camera, beyond which one of them is in doubt
_WIDEST_MM = 200.0  # of the plot of misses
_GAP_PERIODS = 3.0  # between pellets, over which no curve is drawn
_SMALL: Any = {"linestyle": "", "markersize": 3.0, "markeredgewidth": 0.0, "alpha": 0.5}
_Pair = tuple[float, float]


class RehearsedShot(NamedTuple):
    """A pellet of a rehearsal, as it leaves; angles are pitch and yaw [rad]."""

    time_s: float  # since the start of the rehearsal
    is_hit: bool  # whether it hits
    command: _Pair  # in force
    angle: _Pair  # of the gimbal
    line_of_sight: _Pair  # from the pivot to the plate
    miss_m: _Pair | None  # where it passes the plate's centre, left and up; None if never


class Rehearsal(Record, frozen=True, kw_only=True):
    """What a rehearsal counted; printed as its report."""

    schema: ClassVar[str] = "archerfish.rehearsal/1"
    remedy: ClassVar[str] = "rehearse again"
    robot: Text
    """Whose records the computer had."""
    virtual: Text
    """Virtual robot that shot; "identified" is the robot of the records."""
    wire: Text
    """Through which."""
    controller: Text
    """Which aimed."""
    target: tuple[float, float, float, float]
    """Distance, amplitude [m], frequency [Hz] and height [m] of the plate."""
    period_s: float
    """Between decisions [s]."""
    seed: _Count
    """Of all noise."""
    commit: Text
    """Of the code."""
    hits: tuple[_Count, ...]
    """In each second."""
    fired: tuple[_Count, ...]
    """Pellets in each second."""
    messages: dict[str, _Count]
    """What became of them at the computer."""
    violations: dict[str, _Count]
    """Of the robot's limits, by the commands that it received."""
    fault: Text = ""
    """Of the controller, from which on the fallback decided; empty without."""
    faults: tuple[Fault, ...] = ()
    """That the robot had."""
    shots: tuple[RehearsedShot, ...] = ()
    """Each pellet that counts."""
    hit_radius_m: float | None = None
    """Largest distance from the plate's centre of a hit [m]; None if not recorded."""
    camera_m: tuple[float, float, float] | None = None
    """Place of the camera: forward, left and up from the gimbal's pivot [m]; None if not recorded."""
    latencies_ms: tuple[float, float] | None = None
    """Latency of the camera by deploy.toml and by the records [ms]; None without one of them."""
    shots_per_s: float | None = None
    """Most pellets in a second that the gate lets pass; None without that limit."""
    about: Text = ""
    """Command, controller and settings that it was made with; empty if not recorded."""
    conditions: Text = "Virtual time: nothing was late, so nothing here is known of a computer's load."
    """Under which it ran, as a sentence."""

    @property
    def end_s(self) -> float:
        """When the last second that counts ends, from the start on [s]."""
        return COUNTED_FROM_S + len(self.hits)

    @property
    def rate(self) -> HitRate:
        """Hits per decision; one without fire is a miss. A second counts as an engagement in the interval."""
        most = max([self._decisions_per_second, *self.hits])
        found = hit_rate(self.hits, most)
        # A pellet leaves a period after its decision; half a tick is for rounding.
        begin, end = ((time_s + 0.5 * TICK_S) // self.period_s for time_s in (COUNTED_FROM_S, self.end_s))
        decisions = max(round(end - begin), found.hits)
        scale = found.decisions / decisions  # seconds need not have equally many decisions
        return found._replace(decisions=decisions, low=scale * found.low, high=min(1.0, scale * found.high))

    @property
    def pellet_rate(self) -> Estimate:
        """Hits per pellet [%]. So many pellets in a row as a second has decisions are an engagement in the interval.

        With fewer than ten of these there is no interval.
        """
        hits, size = [shot.is_hit for shot in self.shots], self._decisions_per_second
        value = 100.0 * sum(hits) / len(hits) if hits else math.nan
        groups = np.reshape(hits[: len(hits) // size * size], (-1, size))
        if len(groups) < _FEWEST:
            return Estimate(value, math.nan, math.nan, "%")
        rate = hit_rate(groups.sum(axis=1), size)
        return Estimate(value, min(100.0 * rate.low, value), max(100.0 * rate.high, value), "%")

    @property
    def _decisions_per_second(self) -> int:
        return math.ceil(1.0 / self.period_s - 1e-9)

    @property
    def report(self) -> Report:
        """What was counted, in words."""
        rate, fired = self.rate, sum(self.fired)
        percent, interval = entry_texts(self.pellet_rate)
        fewest = _FEWEST * self._decisions_per_second
        uncertain = f"95 %: {interval}" if interval else f"too few for an interval, which {fewest} pellets have"
        kept = sum(self.violations.values()) == 0
        robot = "the robot of its records" if self.virtual == IDENTIFIED else f"the virtual robot {self.virtual}"
        figures: list[tuple[str, Callable[[], Figure]]] = [("Pellets and hits", partial(_seconds, self))]
        if self.shots:
            figures.append(("Line of sight (yaw), command and gimbal at each shot, and its miss", partial(_aim, self)))
            figures.append(("Where the pellets passed the plate's centre", partial(_misses, self)))
        return Report(
            title=f"Rehearsal of {self.controller} with {robot} through {self.wire}",
            headline=f"{rate.hits} of {fired} pellets hit, {percent} % ({uncertain})." if fired else "No pellet left.",
            usable=None if kept else False,
            doubts=tuple(self._doubts()),
            reasons=() if kept else (f"the robot's limits were violated: {self.violations}",),
            known=tuple(self._known(rate)),
            tables=(Table("Messages at the computer", ("", "count"), tuple(self.messages.items())),),
            figures=tuple(figures),
            provenance={"seed": self.seed, "commit": self.commit},
        )

    def _doubts(self) -> list[str]:
        """Return what may be otherwise, as sentences."""
        doubts = list[str]()
        if self.fault:
            doubts.append(f"{self.controller} failed, and the fallback decided where there is one: {self.fault}.")
        if self.virtual == IDENTIFIED:
            doubts.append("The robot was simulated from the records, which don't have friction, saturation or recoil.")
        if self.latencies_ms:
            given, recorded = self.latencies_ms
            if not recorded <= _LARGEST_RATIO * given <= _LARGEST_RATIO**2 * recorded:
                figures = f"{given:g} ms, and the records of {self.robot} have {recorded:.3g} ms"
                doubts.append(f"latency_ms in [detections] of {FILE} is {figures}: check it; it is in milliseconds.")
        return doubts

    def _known(self, rate: HitRate) -> list[str]:
        """Return what the figures mean and rest on, as sentences."""
        distance, amplitude, frequency, _ = self.target
        known = [
            f"{rate.hits} of {rate.decisions} decisions hit, {100.0 * rate.rate:.1f} %; one without fire misses.",
            f"Plate {distance:g} m ahead that swings by {amplitude:g} m at {frequency:g} Hz.",
        ]
        if self.hit_radius_m is not None:
            known.append(f"A hit is within {1e3 * self.hit_radius_m:g} mm of its centre.")
        if self.shots_per_s:
            known.append(f"At most {self.shots_per_s:g} pellets a second, by gate.shots_per_s of {FILE}.")
        else:
            most = f"up to one a decision, {1.0 / self.period_s:.3g} a second, unless the wire reports heat"
            known.append(f"No gate.shots_per_s in {FILE} limits the rate of pellets: {most}.")
        if self.camera_m is not None:
            place = ", ".join(f"{metres:g}" for metres in self.camera_m)
            known.append(f"The camera is at ({place}) m, position_m of {FILE}, whatever a virtual robot's file has.")
        known += [f"Fault: {kind} from {begin:g} to {end:g} s." for kind, begin, end in self.faults]
        known += [
            f"Records of {self.robot}, a decision every {1e3 * self.period_s:g} ms.",
            f"Seed {self.seed}, commit {self.commit}.",
            self.conditions,
        ]
        return known + ([f"About: {self.about}."] if self.about else [])

    def __str__(self) -> str:
        return f"{self.report}"

    __repr__ = __str__


def rehearsal_of(
    pellets: Iterable[Pellet],
    *,
    seconds: int,
    robot: Robot,
    virtual: str,
    wires: Sequence[str | Path],
    config: DeployConfig,
    **fields: Any,
) -> Rehearsal:
    """Return the rehearsal in which some pellets left.

    Args:
      pellets: all, with their times since the start.
      seconds: that count.
      robot: its records.
      virtual: name of the virtual robot.
      wires: names or TOML files.
      config: of deploy.toml.
      fields: the others of a `Rehearsal`.
    """
    # A pellet leaves a period after its decision, so that those of a second are in (begin, end].
    begin_s = COUNTED_FROM_S + 0.5 * TICK_S
    shots = [_rehearsed(pellet) for pellet in pellets if begin_s < pellet.time_s < begin_s + seconds]
    second = np.array([math.ceil(shot.time_s - begin_s) - 1 for shot in shots], int)
    is_hit = np.array([shot.is_hit for shot in shots], bool)
    hits, fired = (np.bincount(chosen, minlength=seconds).tolist() for chosen in (second[is_hit], second))
    return Rehearsal(
        robot=robot.name,
        virtual=virtual,
        wire="+".join(Path(name).stem for name in wires),
        hits=tuple(hits),
        fired=tuple(fired),
        shots=tuple(shots),
        camera_m=config.detections.position_m,
        latencies_ms=_latencies_ms(robot, config),
        shots_per_s=config.gate.shots_per_s,
        commit=code_commit(),
        **fields,
    )


def _latencies_ms(robot: Robot, config: DeployConfig) -> _Pair | None:
    """Return the camera's latency by deploy.toml and by the records [ms], None without one of them."""
    if config.detections.latency_ms is None:
        return None
    with contextlib.suppress(InputError):  # the records have none that counts from exposures
        return config.detections.latency_ms, 1e3 * camera_latency(robot)
    return None


def _rehearsed(pellet: Pellet) -> RehearsedShot:
    x, y, z = pellet.plate.tolist()
    line_of_sight = math.atan2(z, math.hypot(x, y)), math.atan2(y, x)
    rounded = [np.round(pair, 5).tolist() for pair in (pellet.command, pellet.angle, line_of_sight, pellet.miss)]
    command, angle, line_of_sight, miss = [(first, second) for first, second in rounded]
    return RehearsedShot(
        pellet.time_s, pellet.is_hit, command, angle, line_of_sight, None if np.isnan(miss).any() else miss
    )


def _time_panels(rehearsal: Rehearsal, rows: int, height: float) -> tuple[Figure, Any]:
    """Return panels over the whole time, shape (rows,), with the faults shaded; the last one names the axis."""
    figure, axes = new_figure(rows, height=height, sharex=True)
    panels = axes[:, 0]
    for panel in panels:
        for place, fault in enumerate(rehearsal.faults):
            label = "fault" if place == 0 and panel is panels[0] else None
            panel.axvspan(fault.begin_s, fault.end_s, color=PALETTE[5], alpha=0.25, linewidth=0.0, label=label)
    panels[-1].set(xlabel="time [s]", xlim=(0.0, rehearsal.end_s))
    return figure, panels


def _seconds(rehearsal: Rehearsal) -> Figure:
    with plot_style():
        figure, [panel] = _time_panels(rehearsal, 1, 2.4)
        second = np.arange(len(rehearsal.hits)) + COUNTED_FROM_S
        panel.bar(second, rehearsal.fired, 0.9, align="edge", color=MUTED, alpha=0.4, label="pellets")
        panel.bar(second, rehearsal.hits, 0.9, align="edge", label="hits")
        panel.set_ylabel("in each second [1/s]")
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def _aim(rehearsal: Rehearsal) -> Figure:
    shots = rehearsal.shots
    times = np.array([shot.time_s for shot in shots])
    gaps = np.flatnonzero(np.diff(times) > _GAP_PERIODS * rehearsal.period_s) + 1
    curves = {
        "line of sight": [shot.line_of_sight for shot in shots],
        "command": [shot.command for shot in shots],
        "gimbal": [shot.angle for shot in shots],
    }
    with plot_style():
        figure, (yaw_panel, pitch_panel, miss_panel) = _time_panels(rehearsal, 3, 6.0)
        for place, (label, angles) in enumerate(curves.items()):
            # NaN at the gaps, where the curve is interrupted.
            pitch, yaw = np.insert(np.degrees(angles), gaps, math.nan, axis=0).T
            style: Any = {**look(place), "marker": "", "linewidth": 1.0}
            yaw_panel.plot(np.insert(times, gaps, math.nan), yaw, **style, label=label)
            if label != "line of sight":  # its pitch is degrees lower, by the fall of the pellets
                pitch_panel.plot(np.insert(times, gaps, math.nan), pitch, **style)
        yaw_panel.set_ylabel("yaw [°]")
        pitch_panel.set_ylabel("pitch [°]")
        for label, style, chosen in _by_outcome(rehearsal):
            distance = [1e3 * math.hypot(*(shot.miss_m or (math.nan,))) for shot in chosen]
            miss_panel.plot([shot.time_s for shot in chosen], distance, **style, label=label)
        if rehearsal.hit_radius_m is not None:
            miss_panel.axhline(1e3 * rehearsal.hit_radius_m, color=INK, linewidth=1.0, label="radius of a hit")
        miss_panel.set_ylabel("miss [mm]")
        miss_panel.set_ylim(bottom=0.0)
        figure.legend(loc="outside upper center", ncols=7, columnspacing=1.2, handlelength=1.5)
    return figure


def _misses(rehearsal: Rehearsal) -> Figure:
    with plot_style():
        figure, axes = new_figure(height=4.2)
        panel = axes[0, 0]
        for label, style, chosen in _by_outcome(rehearsal):
            left, up = 1e3 * np.reshape([shot.miss_m for shot in chosen if shot.miss_m], (-1, 2)).T
            outside = np.sum(np.maximum(abs(left), abs(up)) > _WIDEST_MM)
            panel.plot(left, up, **style, label=f"{label} ({outside} outside the picture)" if outside else label)
        if rehearsal.hit_radius_m is not None:
            turn = np.linspace(0.0, 2.0 * np.pi, 200)
            outline = 1e3 * rehearsal.hit_radius_m * np.array([np.cos(turn), np.sin(turn)])
            panel.plot(*outline, color=INK, linewidth=1.0, label="radius of a hit")
        panel.set(xlabel="to the left [mm]", ylabel="up [mm]", aspect="equal", xlim=(_WIDEST_MM, -_WIDEST_MM))
        panel.set_ylim(-_WIDEST_MM, _WIDEST_MM)
        figure.legend(loc="outside upper center", ncols=3)
    return figure


def _by_outcome(rehearsal: Rehearsal) -> list[tuple[str, dict[str, Any], list[RehearsedShot]]]:
    """Return label, look and shots of hits and of misses."""
    hits = [shot for shot in rehearsal.shots if shot.is_hit]
    misses = [shot for shot in rehearsal.shots if not shot.is_hit]
    return [("hit", look(0) | _SMALL, hits), ("miss", look(1) | _SMALL, misses)]
