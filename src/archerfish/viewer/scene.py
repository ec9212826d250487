"""The picture of the page: robot, target, pellets, hits and misses; x forward, y left, z up from the gimbal's pivot."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.viewer.motions import FloatArray
from archerfish.viewer.trial import Moment

HIT_COLOUR, MISS_COLOUR, PELLET_COLOUR = (0, 114, 178), (213, 94, 0), (230, 159, 0)
"""Colours that a colour-blind person distinguishes."""
BLACK, STEEL, DARK, PALE, GREEN = (40, 44, 52), (132, 140, 152), (58, 63, 72), (225, 229, 235), (0, 158, 115)
FLOOR_Z = -0.42
"""Height of the floor [m]."""
PLATE_M = (0.135, 0.125)
"""Width and height of a small armor module [m]."""
BOARD_SCALE, BOARD_REACH_M = 6.0, 0.14
"""Magnification of the board that shows the plate's plane, and what it shows of it to each side [m]."""
PELLET_SIZE_M = 0.034
"""As drawn [m]: twice a pellet's."""
Point = tuple[float, float, float]
VIEWPOINTS: dict[str, Callable[[float], tuple[Point, Point]]] = {
    "behind the robot": lambda distance: ((-2.4, -0.85, 1.15), (distance, 0.4, 0.14)),
    "from the side": lambda distance: ((0.5 * distance, -0.95 * distance - 1.2, 0.9), (0.5 * distance, 0.0, 0.0)),
    "at the plate": lambda distance: ((distance - 0.75, -0.22, 0.12), (distance, 0.05, 0.0)),
}
"""Name on the page → distance of the target [m] → where the camera is and what it looks at [m]."""
FIELD_OF_VIEW = 0.85
"""Vertical [rad]."""
NARROW, PORTRAIT = 1.1, 0.75
"""Width by height of a window below which the angle is wider, and below which controls cover its lower part."""
_HIDDEN = np.array([[0.0, 0.0, -50.0]], np.float32)


class Scene:
    """The nodes of the picture."""

    def __init__(self, server: Any) -> None:
        self._scene = server.scene
        self._draw_surroundings()
        self._yaw, self._pitch = self._build_robot()
        self._command = self._scene.add_frame("/robot/command", show_axes=False)
        ray = np.array([[[0.35, 0.0, 0.0], [1.1, 0.0, 0.0]]])
        self._scene.add_line_segments("/robot/command/ray", ray, PELLET_COLOUR, thickness=0.006)
        self._target = self._build_target()
        self._shots = self._points("/target/shots", 0.017)
        self._board = self._scene.add_frame("/board", show_axes=False)
        side, turned = 2.0 * BOARD_SCALE * BOARD_REACH_M, (0.5, 0.5, -0.5, -0.5)
        self._scene.add_image("/board/back", _board_picture(), side, side, wxyz=turned, position=(0.02, 0.0, 0.0))
        self._enlarged = self._points("/board/shots", 0.042)
        self._pellets = self._points("/pellets", PELLET_SIZE_M)
        self._crossed = -1

    def _draw_surroundings(self) -> None:
        # Without a graphics card, light from an environment takes over a second per picture, and lamps a twentieth.
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(cast_shadow=False)
        self._scene.add_light_ambient("/light", intensity=1.3)
        self._scene.add_light_directional("/lamp", intensity=1.2, position=(-3.0, -2.0, 2.0), cast_shadow=False)
        self._scene.add_grid("/floor", 14.0, 8.0, position=(4.0, 0.0, FLOOR_Z), cell_color=PALE, section_color=PALE)

    def _build_robot(self) -> tuple[Any, Any]:
        scene, half = self._scene, math.sqrt(0.5)
        scene.add_box("/robot/chassis", DARK, (0.52, 0.42, 0.12), position=(0.0, 0.0, FLOOR_Z + 0.15))
        for number, (x, y) in enumerate(((0.2, 0.24), (0.2, -0.24), (-0.2, 0.24), (-0.2, -0.24))):
            place = (x, y, FLOOR_Z + 0.09)
            scene.add_cylinder(f"/robot/wheel_{number}", 0.09, 0.06, BLACK, wxyz=(half, half, 0.0, 0.0), position=place)
        scene.add_cylinder("/robot/column", 0.09, 0.12, STEEL, position=(0.0, 0.0, FLOOR_Z + 0.26))
        yaw = scene.add_frame("/robot/yaw", show_axes=False)
        scene.add_box("/robot/yaw/fork", STEEL, (0.08, 0.22, 0.1), position=(0.0, 0.0, -0.1))
        pitch = scene.add_frame("/robot/yaw/pitch", show_axes=False)
        scene.add_box("/robot/yaw/pitch/head", (80, 110, 150), (0.2, 0.14, 0.11), position=(-0.01, 0.0, 0.0))
        scene.add_box("/robot/yaw/pitch/barrel", BLACK, (0.24, 0.036, 0.036), position=(0.2, 0.0, 0.0))
        return yaw, pitch

    def _build_target(self) -> Any:
        scene, (width, height) = self._scene, PLATE_M
        target = scene.add_frame("/target", show_axes=False)
        scene.add_box("/target/plate", (70, 76, 86), (0.012, width, height), position=(0.008, 0.0, 0.0))
        scene.add_box("/target/lights", (86, 180, 233), (0.012, width + 0.03, height), position=(0.01, 0.0, 0.0))
        scene.add_box("/target/pole", PALE, (0.02, 0.02, 0.36), position=(0.02, 0.0, -0.24))
        return target

    def _points(self, name: str, size: float) -> Any:
        style = {"point_shape": "circle", "precision": "float32", "point_shading": "flat"}
        return self._scene.add_point_cloud(name, _HIDDEN, PELLET_COLOUR, point_size=size, **style)

    def arrange(self, distance: float, hit_radius: float, ellipse: list[float]) -> None:
        """Put the board beside the target, and draw hit circle and dispersion ellipse.

        Args:
          distance: of the target [m].
          hit_radius: largest miss that hits [m].
          ellipse: half axes, up and left, that hold 95 % of a perfect aim's pellets [m].
        """
        self._board.position = (distance + 0.6, 1.45, 0.85)
        up, left = (max(half, 1e-4) for half in ellipse)
        big = BOARD_SCALE * hit_radius
        rings = {"/target/circle": (_ring(hit_radius, hit_radius, -0.004), (255, 255, 255), 0.003)}
        rings["/board/circle"] = (_ring(big, big, -0.04), BLACK, 0.014)
        rings["/board/ellipse"] = (_ring(BOARD_SCALE * left, BOARD_SCALE * up, -0.04), GREEN, 0.014)
        for name, (ring, colour, thickness) in rings.items():
            self._scene.add_line_segments(name, ring, colour, thickness=thickness)
        self._crossed = -1

    def draw(self, shown: Moment) -> None:
        """Draw a moment of an engagement."""
        self._yaw.wxyz = turn(0.0, float(shown.angle[1]))
        self._pitch.wxyz = turn(float(shown.angle[0]), 0.0)
        self._command.wxyz = turn(*(float(angle) for angle in shown.command))
        self._target.position = tuple(float(part) for part in shown.place)
        self._pellets.points = shown.pellets.astype(np.float32) if len(shown.pellets) else _HIDDEN
        if len(shown.misses) == self._crossed:
            return
        self._crossed = len(shown.misses)
        colours = np.where(shown.hit[:, None], HIT_COLOUR, MISS_COLOUR).astype(np.uint8)
        reaches = ((self._shots, 1.0, 1.5 * BOARD_REACH_M), (self._enlarged, BOARD_SCALE, BOARD_REACH_M))
        for cloud, scale, reach in reaches:  # what passes farther off is drawn at the edge
            places = scale * np.clip(shown.misses, -reach, reach)
            points = np.pad(places, ((0, 0), (1, 0)), constant_values=-0.05).astype(np.float32)
            cloud.points = points if len(points) else _HIDDEN
            cloud.colors = colours if len(points) else np.array([MISS_COLOUR], np.uint8)


def turn(pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of a gimbal's angles [rad], pitch positive with the muzzle up."""
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(-pitch / 2), math.sin(-pitch / 2)
    return (cy * cp, -sy * sp, cy * sp, sy * cp)


def _ring(y: float, z: float, x: float, corners: int = 48) -> FloatArray:
    """Return line segments of an ellipse in the plane of a plate, shape (corners, 2, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    points = np.stack([np.full(corners + 1, x), y * np.cos(angle), z * np.sin(angle)], axis=-1)
    return np.stack([points[:-1], points[1:]], axis=1)


def _board_picture(pixels: int = 280) -> NDArray[np.uint8]:
    """Return a sheet with an edge, and the plate on it, shape (pixels, pixels, 3)."""
    picture = np.full((pixels, pixels, 3), 252, np.uint8)
    away = np.abs((np.arange(pixels) + 0.5) * 2 * BOARD_REACH_M / pixels - BOARD_REACH_M)
    picture[(away[:, None] <= PLATE_M[1] / 2) & (away[None, :] <= PLATE_M[0] / 2)] = PALE
    picture[np.maximum(away[:, None], away) > BOARD_REACH_M - 0.002] = STEEL
    return picture


def look_from(camera: Any, view: str, distance: float) -> None:
    """Put a camera to one of `VIEWPOINTS`, of a target at a distance [m].

    A narrow window gets a wider angle, and the picture above the controls, which cover its lower part.
    """
    (x, y, z), (middle_x, middle_y, middle_z) = VIEWPOINTS[view](distance)
    aspect = getattr(camera, "aspect", NARROW)
    lowered = 0.5 * math.hypot(middle_x - x, middle_y - y) if aspect < PORTRAIT else 0.0
    camera.position, camera.look_at = (x, y, z), (middle_x, middle_y, middle_z - lowered)
    camera.fov = 2.0 * math.atan(math.tan(0.5 * FIELD_OF_VIEW) * max(1.0, NARROW / aspect))
