"""Where the target will be: four ways to know, one interface.

A predictor is a NamedTuple of arrays with `reset(seen)`, `step(state, seen)` and `position_after(state, time)`; any of
them can serve any aiming controller.
"""

from typing import Any, NamedTuple, Protocol

from archerfish.dynamics.array_namespace import Array, namespace
from archerfish.sensing.interfaces import Seen
from archerfish.sensing.kalman_filter import Track, TrackerNoise, begin_track, position_after, predict, update
from archerfish.targets.parabola import triangle_wave


class Predictor(Protocol):
    """Tracks a target and says where it will be."""

    def reset(self, seen: Seen) -> Any:
        """Begin at the first sight."""

    def step(self, state: Any, seen: Seen) -> Any:
        """Take in what is seen now."""

    def position_after(self, state: Any, time: Array) -> Array:
        """Predict the position [m] after a time [s] from now, shape B → B + (3,)."""


class AgedTrack(NamedTuple):
    """An estimate as of the latest exposure."""

    track: Track
    """Estimate then."""
    age: Array
    """How long ago that was at the latest decision [s], shape B."""


class Hold(NamedTuple):
    """The target stays where it is seen: no lead."""

    def reset(self, seen: Seen) -> Array:
        """Begin at the first sight."""
        return seen.plate[..., 0, :]

    def step(self, state: Array, seen: Seen) -> Array:  # noqa: ARG002
        """Take in what is seen now: the position, shape B + (3,)."""
        return seen.plate[..., 0, :]

    def position_after(self, state: Array, time: Array) -> Array:
        """Return the position as seen last, shape B + (3,)."""
        return state + 0.0 * namespace(state, time).asarray(time)[..., None]


class ConstantVelocity(NamedTuple):
    """A Kalman filter for nearly constant velocity, kept as of the latest exposure and carried on from there."""

    noise: TrackerNoise
    """What the filter believes of the target and the camera."""
    velocity_decay: Array = 1.0
    """Share of the estimated velocity at which the target is predicted to go on, 0…1, shape ()."""

    def reset(self, seen: Seen) -> AgedTrack:
        """Begin at the first sight."""
        return AgedTrack(begin_track(self.noise, seen.plate[..., 0, :], seen.fresh[..., 0]), seen.plate_age[..., 0])

    def step(self, state: AgedTrack, seen: Seen) -> AgedTrack:
        """Take in what is seen now."""
        age = seen.plate_age[..., 0]
        track = predict(self.noise, state.track, state.age + seen.elapsed - age)
        # The first sight began the track; it tells nothing new.
        fresh = seen.fresh[..., 0] & (seen.elapsed > 0.0)
        return AgedTrack(update(self.noise, track, seen.plate[..., 0, :], fresh), age)

    def position_after(self, state: AgedTrack, time: Array) -> Array:
        """Go on at a share of the estimated velocity, shape B + (3,)."""
        return position_after(state.track, state.age + time, self.velocity_decay)


class ParabolaTrack(NamedTuple):
    """What a parabola predictor knows of a target."""

    first: Array
    """First position seen [m], shape B + (3,)."""
    plate: Array
    """Latest position [m], shape B + (3,)."""
    products: Array
    """Sum of g y over the frames, shape B."""
    squares: Array
    """Sum of y² over the frames, shape B."""
    speed: Array
    """Lateral speed [m/s], shape B."""
    frames: Array
    """Frames that the speed is a mean of, shape B."""
    heading: Array
    """1 moving left, −1 moving right, shape B."""


class ParabolaAware(NamedTuple):
    """A predictor that knows the rule of eq (7), its curvature and its width, but not the vertex.

    With x and y counted from the first position seen, eq (7) reads x − c y² = 2 c (y_first − Y₀) y: a line through the
    origin whose slope gives the vertex by least squares over all frames. The lateral speed is constant but for its
    sign.
    """

    curvature: Array
    """c [1/m]."""
    half_width: Array
    """Distance from the vertex at which the target turns back [m]."""

    def reset(self, seen: Seen) -> ParabolaTrack:
        """Begin at the first sight."""
        plate = seen.plate[..., 0, :]
        zero = 0.0 * plate[..., 0]
        return ParabolaTrack(plate, plate, zero, zero, zero, zero, zero + 1.0)

    def step(self, state: ParabolaTrack, seen: Seen) -> ParabolaTrack:
        """Take in what is seen now."""
        xp = namespace(state.plate)
        plate = seen.plate[..., 0, :]
        x, y = (plate[..., index] - state.first[..., index] for index in (0, 1))
        products = state.products + (x - self.curvature * y**2) * y
        state = state._replace(products=products, squares=state.squares + y**2)
        before = state.plate[..., 1] - self._vertex_lateral(state)
        moved = plate[..., 1] - state.plate[..., 1]
        way, expected = xp.abs(moved), state.speed * seen.elapsed
        # By way of the nearer end; the target turned there if that is nearer to what its speed lets expect.
        end = xp.sign(2.0 * before + moved)
        way_by_end = 2.0 * self.half_width - xp.abs(2.0 * before + moved)
        turned = (xp.abs(way_by_end - expected) < xp.abs(way - expected)) & (state.frames > 0.0)
        heading = xp.where(turned, -end, xp.where(way > 0.0, xp.sign(moved), state.heading))
        counts = (seen.elapsed > 0.0) & ~turned
        # A turn within the first frame can't be told; it then shows less than the second, which counts alone.
        frames = xp.where((state.frames == 1.0) & (way > expected), 0.0, state.frames) + counts
        rate = way / xp.maximum(seen.elapsed, 1e-6)
        speed = xp.where(counts, state.speed + (rate - state.speed) / xp.maximum(frames, 1.0), state.speed)
        return state._replace(plate=plate, speed=speed, frames=frames, heading=heading)

    def position_after(self, state: ParabolaTrack, time: Array) -> Array:
        """Follow the parabola and turn back at its ends, shape B + (3,)."""
        xp = namespace(state.plate, time)
        width = self.half_width
        offset = xp.clip(state.plate[..., 1] - self._vertex_lateral(state), -width, width)
        ahead = (state.heading * offset + state.speed * time) / (4.0 * width) + 0.25
        later = state.heading * width * triangle_wave(ahead)
        forward = self.curvature * (later**2 - offset**2)
        return state.plate + xp.stack([forward, later - offset, 0.0 * forward], axis=-1)

    def vertex(self, state: ParabolaTrack) -> Array:
        """Return the estimated vertex [m], shape B + (3,)."""
        xp = namespace(state.plate)
        lateral = self._vertex_lateral(state)
        forward = state.plate[..., 0] - self.curvature * (state.plate[..., 1] - lateral) ** 2
        return xp.stack([forward, lateral, state.plate[..., 2]], axis=-1)

    def _vertex_lateral(self, state: ParabolaTrack) -> Array:
        slope = state.products / (state.squares + 1e-12)
        bound = 2.0 * self.curvature * self.half_width
        slope = namespace(slope).clip(slope, -bound, bound)
        return state.first[..., 1] - slope / (2.0 * self.curvature)


class Vertex(NamedTuple):
    """Waits at the vertex of the parabola, where the target passes again and again."""

    parabola: ParabolaAware
    """Finds the vertex."""

    def reset(self, seen: Seen) -> ParabolaTrack:
        """Begin at the first sight."""
        return self.parabola.reset(seen)

    def step(self, state: ParabolaTrack, seen: Seen) -> ParabolaTrack:
        """Take in what is seen now."""
        return self.parabola.step(state, seen)

    def position_after(self, state: ParabolaTrack, time: Array) -> Array:
        """Return the vertex, shape B + (3,)."""
        return self.parabola.vertex(state) + 0.0 * namespace(state.plate, time).asarray(time)[..., None]
