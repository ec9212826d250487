"""A small picture of an engagement, drawn with NumPy alone: no display and no OpenGL is needed.

Left the field as the gimbal's pivot sees it: the plate, where the gimbal points (cross), and the command in force
(hollow square). Right the plate from near: the circle within which a pellet hits, and the last pellets, the newest
brightest, green for hits and red for misses.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEIGHT, FIELD_WIDTH, NEAR_WIDTH = 240, 400, 240
"""Size of the picture and of its two parts [pixels]."""
FIELD_VIEW, NEAR_VIEW = math.radians(80.0), 0.4
"""Horizontal angle of the left part [rad], width of the right part at the plate [m]."""
PLATE_SIZE = (0.135, 0.055)
"""Width and height of a small armor plate [m]."""
BACKGROUND, FRAME, PLATE, GIMBAL, COMMAND = (24, 26, 30), (70, 74, 82), (120, 170, 230), (240, 240, 240), (240, 190, 60)
HIT, MISS = (80, 200, 120), (230, 80, 70)
REMEMBERED = 12
"""Pellets that are shown."""
Picture = NDArray[np.uint8]


def draw_picture(angle: Any, command: Any, plate: Any, misses: Any, hit_radius: float) -> Picture:
    """Draw an engagement.

    Args:
      angle: pitch and yaw of the gimbal [rad], shape (2,).
      command: in force [rad], shape (2,).
      plate: relative to the pivot [m], shape (3,).
      misses: left and up of the plate's centre [m], oldest first, shape (k, 2).
      hit_radius: largest miss that hits [m].

    Returns:
      Shape (HEIGHT, FIELD_WIDTH + NEAR_WIDTH, 3).
    """
    field, near = _canvas(FIELD_WIDTH), _canvas(NEAR_WIDTH)
    scale, (x, y, z) = FIELD_WIDTH / FIELD_VIEW, (float(each) for each in plate)
    away = math.hypot(x, y)

    def pixel(pitch: float, yaw: float) -> tuple[float, float]:
        return HEIGHT / 2 - scale * pitch, FIELD_WIDTH / 2 - scale * yaw

    # Never less than a few pixels: a plate at 5 m is 1.5° wide.
    half = [max(0.5 * scale * size / max(away, 0.1), 2.0) for size in PLATE_SIZE]
    _box(field, pixel(math.atan2(z, away), math.atan2(y, x)), half[1], half[0], PLATE)
    place, cross = pixel(*map(float, command)), pixel(*map(float, angle))
    _box(field, place, 5, 5, COMMAND)
    _box(field, place, 3, 3, BACKGROUND)
    _box(field, cross, 0.5, 9, GIMBAL)
    _box(field, cross, 9, 0.5, GIMBAL)
    scale, centre = NEAR_WIDTH / NEAR_VIEW, (HEIGHT / 2, NEAR_WIDTH / 2)
    _box(near, centre, 0.5 * scale * PLATE_SIZE[1], 0.5 * scale * PLATE_SIZE[0], FRAME)
    rows, columns = np.ogrid[:HEIGHT, :NEAR_WIDTH]
    near[np.abs(np.hypot(rows - centre[0], columns - centre[1]) - scale * hit_radius) <= 1.0] = PLATE
    shown = [each for each in misses if np.isfinite(each).all()][-REMEMBERED:]
    for age, (left, up) in zip(range(len(shown), 0, -1), shown, strict=True):
        colour = HIT if math.hypot(left, up) <= hit_radius else MISS
        # What flies past outside the picture is put on its edge.
        spot = [min(max(each, 3.0), HEIGHT - 4.0) for each in (centre[0] - scale * up, centre[1] - scale * left)]
        _box(near, (spot[0], spot[1]), 2, 2, tuple(round(part * (1.0 - 0.06 * age)) for part in colour))
    return np.concatenate([field, near], axis=1)


def _canvas(width: int) -> Picture:
    canvas = np.full((HEIGHT, width, 3), FRAME, np.uint8)
    canvas[1:-1, 1:-1] = BACKGROUND
    return canvas


def _box(canvas: Picture, centre: tuple[float, float], high: float, wide: float, colour: tuple[int, ...]) -> None:
    """Fill a rectangle of half a height and half a width, as far as it lies on the canvas."""
    edges = []
    for middle, half, size in zip(centre, (high, wide), canvas.shape, strict=False):
        ends = (min(max(round(each), 0), size) for each in (middle - half, middle + half + 1))
        edges.append(slice(*ends))
    canvas[edges[0], edges[1]] = colour
