"""A small picture of an engagement, drawn with NumPy alone: no display and no OpenGL is needed.

Left the field as the gimbal's base sees it: the armor, where the gimbal points (cross) and where it was told to point
(hollow square). Right the armor from near: the circle within which a pellet hits, and the last pellets, the newest
brightest, green for hits and red for misses.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HEIGHT, FIELD_WIDTH, NEAR_WIDTH = 240, 400, 240
"""Size of the picture and of its two parts [pixels]."""
FIELD_VIEW = math.radians(80.0)
"""Horizontal angle of the left part [rad]."""
NEAR_VIEW = 0.4
"""Width of the right part, at the armor [m]."""
ARMOR_SIZE = (0.135, 0.055)
"""Width and height of a small armor plate [m]."""
BACKGROUND, FRAME, ARMOR, GIMBAL, COMMAND = (24, 26, 30), (70, 74, 82), (120, 170, 230), (240, 240, 240), (240, 190, 60)
HIT, MISS = (80, 200, 120), (230, 80, 70)
REMEMBERED = 12
"""Pellets that are shown."""

Picture = NDArray[np.uint8]


class View(NamedTuple):
    """What is drawn of an engagement."""

    angle: NDArray[np.float32]
    """Pitch and yaw of the gimbal [rad], shape (2,)."""
    command: NDArray[np.float32]
    """Command in force [rad], shape (2,)."""
    plate: NDArray[np.float32]
    """Armor as seen [m], shape (3,)."""
    misses: NDArray[np.float32]
    """Pellet minus armor in y and z [m], oldest first, shape (k, 2)."""
    hit_radius: float
    """Largest miss that hits [m]."""


def draw(view: View) -> Picture:
    """Draw an engagement, shape (HEIGHT, FIELD_WIDTH + NEAR_WIDTH, 3)."""
    return np.concatenate([_field(view), _near(view)], axis=1)


def _field(view: View) -> Picture:
    canvas = _canvas(FIELD_WIDTH)
    scale = FIELD_WIDTH / FIELD_VIEW
    x, y, z = (float(each) for each in view.plate)
    away = math.hypot(x, y)

    def pixel(pitch: float, yaw: float) -> tuple[float, float]:
        # Yaw is positive to the left, pitch with the muzzle up.
        return HEIGHT / 2 - scale * pitch, FIELD_WIDTH / 2 - scale * yaw

    centre = pixel(math.atan2(z, away), math.atan2(y, x))
    # Never less than a few pixels: an armor at 5 m is 1.5° wide.
    half = [max(0.5 * scale * size / max(away, 0.1), 2.0) for size in ARMOR_SIZE]
    _box(canvas, centre, half[1], half[0], ARMOR)
    row, column = pixel(*(float(each) for each in view.command))
    _box(canvas, (row, column), 5, 5, COMMAND)
    _box(canvas, (row, column), 3, 3, BACKGROUND)
    row, column = pixel(*(float(each) for each in view.angle))
    _box(canvas, (row, column), 0.5, 9, GIMBAL)
    _box(canvas, (row, column), 9, 0.5, GIMBAL)
    return canvas


def _near(view: View) -> Picture:
    canvas = _canvas(NEAR_WIDTH)
    scale, centre = NEAR_WIDTH / NEAR_VIEW, (HEIGHT / 2, NEAR_WIDTH / 2)
    _box(canvas, centre, 0.5 * scale * ARMOR_SIZE[1], 0.5 * scale * ARMOR_SIZE[0], FRAME)
    _ring(canvas, centre, scale * view.hit_radius, ARMOR)
    misses = view.misses[-REMEMBERED:]
    for age, (left, up) in zip(range(len(misses), 0, -1), misses, strict=True):
        colour = HIT if math.hypot(left, up) <= view.hit_radius else MISS
        # What flies past outside the picture is put on its edge.
        row, column = (min(max(each, 3.0), HEIGHT - 4.0) for each in (centre[0] - scale * up, centre[1] - scale * left))
        _box(canvas, (row, column), 2, 2, tuple(round(part * (1.0 - 0.06 * age)) for part in colour))
    return canvas


def _canvas(width: int) -> Picture:
    canvas = np.full((HEIGHT, width, 3), FRAME, np.uint8)
    canvas[1:-1, 1:-1] = BACKGROUND
    return canvas


def _box(
    canvas: Picture, centre: tuple[float, float], half_height: float, half_width: float, colour: tuple[int, ...]
) -> None:
    edges = []
    for middle, half, size in zip(centre, (half_height, half_width), canvas.shape, strict=False):
        edges.append(slice(min(max(round(middle - half), 0), size), min(max(round(middle + half) + 1, 0), size)))
    canvas[edges[0], edges[1]] = colour


def _ring(canvas: Picture, centre: tuple[float, float], radius: float, colour: tuple[int, ...]) -> None:
    rows, columns = np.ogrid[: canvas.shape[0], : canvas.shape[1]]
    distance = np.hypot(rows - centre[0], columns - centre[1])
    canvas[np.abs(distance - radius) <= 1.0] = colour
