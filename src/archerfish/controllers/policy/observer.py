"""How a policy observes and acts: what it remembers, what its blocks get, and what an action means.

The kinds of observation `paper` and `history` aim at the latest detection. `tracked` and `multimodel` have trackers:
they aim at the place where the quick filter estimates the target now, and the command is the next one on the fastest
slew to what the action asks for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from archerfish.arrays import Array, lift, map_arrays, namespace, select, tree
from archerfish.dynamics.aiming import aim_at
from archerfish.dynamics.command_limits import approach
from archerfish.dynamics.muzzle import Muzzle
from archerfish.errors import InputError
from archerfish.plugins import find_plugin
from archerfish.protocols import Base, Command, Seen, aim, seen_ahead
from archerfish.tracking.detections import azimuth_near, level_distance, unwrapped
from archerfish.tracking.kalman_filter import against_pivot, position_after
from archerfish.tracking.legendre_memory import Window, constant_history, with_sample
from archerfish.tracking.side_by_side import Trackers, Tracks

DETECTIONS = 8
"""Raw detections that are remembered."""


class Decisions(NamedTuple):
    """Of the last decisions, the newest last, shapes B + (frames, ...); of one, without that axis."""

    angle: Array  # of the gimbal [rad], (2,)
    command: Array  # in force [rad], (2,)
    aim: Array  # pitch, yaw [rad] and distance [m] of the latest detection, (3,); None with trackers


class DetectionMemory(NamedTuple):
    """The latest detection at the last decisions, the newest last, B + (detections,); of one, without that axis."""

    azimuth: Array  # [rad]
    distance: Array  # on level ground [m]


class Memory(NamedTuple):
    """What is remembered between decisions."""

    tracks: Tracks
    decisions: Decisions
    detections: Any  # DetectionMemory; None without trackers
    histories: tuple[Array, ...]  # Legendre coefficients, B + (d,) each
    gimbal_age: Array  # of the latest feedback [s], B
    base: Base  # now
    clock: Array  # since the first decision [s], B


@dataclass(frozen=True, eq=False)
class View:
    """A decision as the blocks need it; tracks are relative to the own pivot and its velocity."""

    memory: Memory
    aim: Array  # at the target as estimated now [rad], B + (2,)
    relative: Array  # that estimate, against the own pivot [m], B + (3,)
    fast: Any  # Track
    slow: Any  # Track
    seen: Seen | None = None  # of this decision; None where an action alone is decoded

    @cached_property
    def distance(self) -> Array:
        """Distance of the target, on level ground with trackers, of its latest detection without [m], B + (1,)."""
        if self.fast is None:
            return self.memory.decisions.aim[..., -1, 2:]
        return level_distance(self.relative)[..., None]

    @cached_property
    def azimuth(self) -> Array:
        """Azimuth of the target, nearest to that of its latest detection, or to the command's yaw [rad], B + (1,)."""
        detections, command = self.memory.detections, self.memory.decisions.command
        near = command[..., -1, 1] if detections is None else detections.azimuth[..., -1]
        return azimuth_near(self.relative, near)[..., None]

    @cached_property
    def direction(self) -> Array:
        """Unit vector to the target on level ground, B + (2,)."""
        return self.relative[..., :2] / level_distance(self.relative)[..., None]

    def across(self, level: Array) -> Array:
        """Return the part of a level vector to the left of the line of sight, shape B + (2,) → B + (1,)."""
        return self.direction[..., :1] * level[..., 1:] - self.direction[..., 1:] * level[..., :1]

    def away(self, level: Array) -> Array:
        """Return the part of a level vector along the line of sight, shape B + (2,) → B + (1,)."""
        return namespace(level).sum(self.direction * level, axis=-1, keepdims=True)

    def unwrapped(self, angle: Array) -> Array:
        """Return pitch and yaw [rad] with the yaw nearest to that of the command, shape B + (2,)."""
        return unwrapped(angle, self.memory.decisions.command[..., -1, :])


Block = Callable[["Observer", View], Array]
"""A block of an observation: a function of the observer and the view that returns numbers, shape B + (k,)."""


@tree(static=("blocks", "frames"))
class Observer:
    """How a policy sees and acts; the same in NumPy on a robot and inside a compiled training."""

    blocks: tuple[Block, ...]  # of the observation
    trackers: Trackers
    windows: tuple[Window, ...]  # of azimuth, distance, azimuth for long
    frames: int  # decisions that are remembered
    action_scale: Array  # offset from the aim per unit of action, pitch and yaw [rad], (2,)
    largest_move: Array  # of the command from one decision to the next, pitch and yaw [rad], (2,)
    braking: Array  # by how much that move may change, pitch and yaw [rad], (2,)
    muzzle: Muzzle  # that the aim is computed for

    def begin(self, seen: Seen) -> Memory:
        """Return the memory at the first decision, as if nothing had moved before it; shape B."""
        xp, zero = namespace(seen.command), 0.0 * seen.elapsed
        tracks = self.trackers.begin(seen)
        detection = self._detection(tracks, zero)

        def repeated(newest: Any, count: int) -> Any:
            return map_arrays(lambda array: xp.stack([array] * count, axis=zero.ndim), newest)

        decisions = repeated(self._decision(tracks, seen), self.frames)
        histories = tuple(map(constant_history, self.windows, _samples(detection)))
        detections = repeated(detection, DETECTIONS)
        return Memory(tracks, decisions, detections, histories, seen.gimbal.age, seen.base, zero)

    def remember(self, memory: Memory, seen: Seen) -> Memory:
        """Update the memory with what is seen at a decision, the first one included; shape B."""
        xp, later = namespace(seen.command), seen.elapsed > 0.0
        tracks = self.trackers.update(memory.tracks, seen)
        detection = self._detection(tracks, memory.detections and memory.detections.azimuth[..., -1])
        batch = (slice(None),) * later.ndim

        def pushed(series: Array, newest: Array) -> Array:
            return xp.concat([series[(*batch, slice(1, None))], newest[(*batch, None)]], axis=later.ndim)

        decisions = map_arrays(pushed, memory.decisions, self._decision(tracks, seen))
        detections = map_arrays(pushed, memory.detections, detection)
        histories = tuple(map(with_sample, self.windows, memory.histories, _samples(detection)))
        # At the first decision, which `begin` has remembered already, nothing is added.
        before = memory.decisions, memory.detections, memory.histories
        kept = select(later, (decisions, detections, histories), before)
        return Memory(tracks, *kept, seen.gimbal.age, seen.base, memory.clock + seen.elapsed)

    def view(self, memory: Memory, seen: Seen | None = None) -> View:
        """Return the decision as the blocks need it, with what is seen at it for blocks of a user's own; shape B."""
        tracks, base = memory.tracks, memory.base
        if tracks.fast is None:
            return View(memory, memory.decisions.aim[..., -1, :2], tracks.place - base.position, None, None, seen)
        fast = against_pivot(tracks.fast, base, tracks.age)
        slow = tracks.slow and against_pivot(tracks.slow, base, tracks.age)
        relative = position_after(fast, tracks.age)
        angle = unwrapped(aim_at(relative, self.muzzle).angle, memory.decisions.command[..., -1, :])
        return View(memory, angle, relative, fast, slow, seen)

    def observe(self, view: View) -> Array:
        """Return the observation, shape B + (n,)."""
        return namespace(view.aim).concat([block(self, view) for block in self.blocks], axis=-1)

    def decode(self, view: View, action: Array) -> Command:
        """Turn an action, shape B + (2,), into a command; zero aims at the target as estimated now."""
        wanted = view.aim + lift(self.action_scale, action) * action
        if self.trackers.fast is None:
            return aim(wanted)
        return aim(approach(wanted, view.memory.decisions.command[..., -1, :], self.largest_move, self.braking, 1.0))

    def layout(self) -> list[tuple[str, int]]:
        """Return name and size of the blocks, in order; in NumPy, with an observer of NumPy's arrays.

        Raises:
          InputError: if a block of a user's own fails, or returns another shape, or numbers that are not finite.
        """
        seen, sizes = seen_ahead(2), []
        memory = self.begin(seen)
        for elapsed in (0.0, *[0.02] * 4):
            memory = self.remember(memory, seen._replace(elapsed=seen.elapsed + np.float32(elapsed)))
        view = self.view(memory, seen)
        if not np.all(np.isfinite(self.decode(view, 0.0 * seen.command).angle)):
            raise InputError("the observer gives commands that are not finite; train again")
        for block in self.blocks:
            plugin = find_plugin(block, "block")
            with plugin.running():
                numbers = np.asarray(block(self, view))
                if numbers.shape[:-1] != (2,) or numbers.dtype.kind != "f" or not np.all(np.isfinite(numbers)):
                    found = f"{numbers.dtype} of shape {numbers.shape}"
                    raise InputError(f"returns {found} for a batch (2,), expected finite floats, (2, k); correct it")
            sizes.append((plugin.name, numbers.shape[-1]))
        return sizes

    def _decision(self, tracks: Tracks, seen: Seen) -> Decisions:
        if self.trackers.fast is not None:
            return Decisions(seen.gimbal.angle, seen.command, None)
        xp, relative = namespace(seen.command), tracks.place - seen.base.position
        angle = unwrapped(aim_at(relative, self.muzzle).angle, seen.command)
        distance = xp.sqrt(xp.sum(relative**2, axis=-1, keepdims=True))
        return Decisions(seen.gimbal.angle, seen.command, xp.concat([angle, distance], axis=-1))

    def _detection(self, tracks: Tracks, azimuth: Array) -> DetectionMemory | None:
        """Return the latest detection as the own pivot saw it, with the azimuth nearest to an earlier one, shape B."""
        if self.trackers.fast is None:
            return None
        relative = tracks.place - tracks.own
        return DetectionMemory(azimuth_near(relative, azimuth), level_distance(relative))


def _samples(detection: DetectionMemory | None) -> tuple[Array, ...]:
    """Return the newest samples of the histories: azimuth, distance, azimuth for long; none without trackers."""
    return () if detection is None else (*detection, detection.azimuth)
