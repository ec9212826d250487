"""Shots: where pellets went, and how fast they left the muzzle."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from archerfish.records.errors import InputError

Array = NDArray[np.float64]

_MEASURED = ("hit_height", "speed", "lateral")
"""Arrays that a set of shots may lack."""


@dataclass(frozen=True)
class Shots:
    """Landing points on level ground or hits on vertical target planes, one entry per shot."""

    pitch: Array
    """Barrel's elevation [rad], muzzle up positive, shape (N,)."""
    yaw: Array
    """Barrel's azimuth [rad], left positive, shape (N,)."""
    distance: Array
    """Horizontal distance from the muzzle to the landing point, or straight ahead to the target plane [m], shape
    (N,)."""
    speed: Array | None = None
    """Measured muzzle speed [m/s], shape (N,), where it was measured."""
    lateral: Array | None = None
    """Distance from the barrel's vertical plane to the landing point, or from the point straight ahead of the muzzle at
    yaw 0 to the hit on the target plane [m], left positive, shape (N,), if measured."""
    source: str = ""
    """Where the shots come from, for messages and titles."""
    hit_height: Array | None = None
    """Height of the hit on the target plane above the muzzle [m], shape (N,); None for landing points."""
    places: tuple[str, ...] = ()
    """Where each shot is written down, such as "shots.csv line 7"; empty where they are only numbered."""

    def __len__(self) -> int:
        return int(self.distance.size)

    @property
    def on_plane(self) -> bool:
        """Whether the shots are hits on a target plane."""
        return self.hit_height is not None

    def place(self, index: int) -> str:
        """Name a shot for a message."""
        return self.places[index] if self.places else f"shot {index + 1}"


def vertical_measurement(shots: Shots) -> Array:
    """Return what the elevation of departure decides [m]: the landing distance or the hit's height, shape (N,)."""
    return shots.distance if shots.hit_height is None else shots.hit_height


def departure_azimuth(shots: Shots) -> Array | None:
    """Return the azimuth of each departure against the barrel's [rad], shape (N,); None without lateral distances."""
    if shots.lateral is None:
        return None
    if shots.on_plane:
        return np.asarray(np.arctan2(shots.lateral, shots.distance) - shots.yaw)
    return np.asarray(np.arcsin(np.clip(shots.lateral / shots.distance, -1.0, 1.0)))


def settings(shots: Shots) -> NDArray[np.intp]:
    """Return the number of each shot's setting, from 0, shape (N,); shots of one pitch and plane repeat each other."""
    kinds = [np.round(shots.pitch, 6), np.round(shots.distance, 4) if shots.on_plane else np.zeros(len(shots))]
    return np.unique(np.stack(kinds, axis=1), axis=0, return_inverse=True)[1].ravel()


def setting_names(shots: Shots) -> list[str]:
    """Name each setting by what it has of its own, such as "3° pitch", "4 m" or "4 m, 3° pitch"."""
    number = settings(shots)
    first = [int(np.argmax(number == group)) for group in range(number.max() + 1)]
    pitches = [f"{np.degrees(shots.pitch[index]):.3g}° pitch" for index in first]
    planes = [f"{shots.distance[index]:.3g} m" for index in first]
    if not shots.on_plane or len(set(planes)) == 1:
        return pitches
    if len(set(pitches)) == 1:
        return planes
    return [f"{plane}, {pitch}" for plane, pitch in zip(planes, pitches, strict=True)]


def select_shots(shots: Shots, kept: NDArray[np.bool_]) -> Shots:
    """Return some of the shots.

    Args:
      shots: the shots.
      kept: which of them, shape (N,).
    """
    arrays = {name: getattr(shots, name)[kept] for name in ("pitch", "yaw", "distance")}
    measured = {name: getattr(shots, name)[kept] for name in _MEASURED if getattr(shots, name) is not None}
    places = tuple(place for place, keep in zip(shots.places, kept, strict=True) if keep) if shots.places else ()
    return replace(shots, **arrays, **measured, places=places)


def merge_shots(several: Sequence[Shots]) -> Shots:
    """Join shots of one muzzle from several files.

    Raises:
      InputError: if some are landing points and others hits on a plane, or some have measured speeds (or lateral
        distances) and others don't.
    """
    for name, said in (
        ("hit_height", "hits on a target plane"),
        ("speed", "measured speeds"),
        ("lateral", "lateral distances"),
    ):
        having = [shots.source for shots in several if getattr(shots, name) is not None]
        if 0 < len(having) < len(several):
            raise InputError(
                f"{having[0]}: has {said} and other files have none; give only files of the same columns",
                "mixed-columns",
            )

    def joined(name: str) -> Array | None:
        parts = [getattr(shots, name) for shots in several]
        return None if parts[0] is None else np.concatenate(parts)

    pitch, yaw, distance = (
        np.concatenate([getattr(s, name) for s in several]) for name in ("pitch", "yaw", "distance")
    )
    return Shots(
        pitch,
        yaw,
        distance,
        **{name: joined(name) for name in _MEASURED},
        source=", ".join(shots.source for shots in several),
        places=tuple(shots.place(index) for shots in several for index in range(len(shots))),
    )
