"""What is seen: robot, target, pellets, hits and misses. x forward, y left, z up, origin at the gimbal's pivot."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from archerfish.viewer.trial import Floats, Moment

Place = tuple[float, float, float]

HIT, MISS, PELLET = (0, 114, 178), (213, 94, 0), (230, 159, 0)
"""Colours that a colour-blind person tells apart."""
INK, STEEL, DARK, PALE = (40, 44, 52), (132, 140, 152), (58, 63, 72), (225, 229, 235)
FLOOR = -0.42
"""Height of the floor [m]."""
ARMOR = (0.135, 0.125)
"""Width and height of a small armor module [m]."""
ELLIPSE_SCALE = math.sqrt(-2.0 * math.log(0.05))
"""Half axes of the ellipse that holds 95 % of a normal scatter, in standard deviations."""
BOARD_SCALE = 6.0
"""The board shows the armor so many times its size."""
BOARD_REACH = 0.14
"""What the board shows of the armor's plane, to each side [m]; what passes farther off is put on its edge."""
MOST_PELLETS = 32
"""In flight at once."""
PELLET_SIZE = 0.034
"""As drawn [m]: twice a pellet's, to be seen at all."""
VIEWPOINTS: dict[str, Callable[[float], tuple[Place, Place]]] = {
    "behind the robot": lambda distance: ((-2.4, -0.85, 1.15), (distance, 0.4, 0.14)),
    "from the side": lambda distance: ((0.5 * distance, -0.95 * distance - 1.2, 0.9), (0.5 * distance, 0.0, 0.0)),
    "at the armor": lambda distance: ((distance - 0.75, -0.22, 0.12), (distance, 0.05, 0.0)),
}
"""Name on the page → distance of the target [m] → where the camera is and what it looks at [m]."""
FIELD_OF_VIEW = 0.85
"""Vertical [rad]: narrower than usual, since the armor is far and small."""
_HIDDEN = (0.0, 0.0, -50.0)


class Scene:
    """The nodes of the page's picture, and how a moment is drawn with them."""

    def __init__(self, server: Any) -> None:
        self._scene = server.scene
        self._draw_surroundings()
        self._yaw, self._pitch = self._build_robot()
        self._command = self._ray("/robot/command", PELLET)
        self._target = self._build_target()
        self._board = self._build_board()
        self._pellets = self._points("/pellets", PELLET_SIZE)
        self._caption = self._scene.add_label("/caption", "", position=(0.0, 0.0, 0.3), anchor="bottom-center")
        self._landed = -1
        self._in_flight = -1

    def _draw_surroundings(self) -> None:
        # Without a graphics card, light from an environment takes over a second per picture, and lamps a twentieth.
        self._scene.configure_environment_map(None)
        self._scene.configure_default_lights(cast_shadow=False)
        self._scene.add_light_ambient("/light", intensity=1.3)
        self._scene.add_light_directional("/lamp", intensity=1.2, position=(-3.0, -2.0, 2.0), cast_shadow=False)
        self._scene.add_grid(
            "/floor", 14.0, 8.0, position=(4.0, 0.0, FLOOR), cell_color=PALE, section_color=(190, 196, 205)
        )

    def _build_robot(self) -> tuple[Any, Any]:
        scene = self._scene
        scene.add_box("/robot/chassis", DARK, (0.52, 0.42, 0.12), position=(0.0, 0.0, FLOOR + 0.15))
        for name, x, y in (("fl", 0.2, 0.24), ("fr", 0.2, -0.24), ("bl", -0.2, 0.24), ("br", -0.2, -0.24)):
            across = (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0)
            place = (x, y, FLOOR + 0.09)
            scene.add_cylinder(f"/robot/wheel_{name}", 0.09, 0.06, INK, wxyz=across, position=place)
        scene.add_cylinder("/robot/column", 0.09, 0.12, STEEL, position=(0.0, 0.0, FLOOR + 0.26))
        yaw = scene.add_frame("/robot/yaw", show_axes=False)
        scene.add_box("/robot/yaw/base", STEEL, (0.2, 0.22, 0.03), position=(0.0, 0.0, -0.12))
        for name, y in (("left", 0.1), ("right", -0.1)):
            scene.add_box(f"/robot/yaw/fork_{name}", STEEL, (0.08, 0.02, 0.2), position=(0.0, y, -0.03))
        pitch = scene.add_frame("/robot/yaw/pitch", show_axes=False)
        scene.add_box("/robot/yaw/pitch/head", (80, 110, 150), (0.2, 0.14, 0.11), position=(-0.01, 0.0, 0.0))
        along = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
        scene.add_cylinder("/robot/yaw/pitch/barrel", 0.019, 0.24, INK, wxyz=along, position=(0.2, 0.0, 0.0))
        return yaw, pitch

    def _ray(self, name: str, colour: tuple[int, int, int]) -> Any:
        frame = self._scene.add_frame(name, show_axes=False)
        ends = np.array([[[0.35, 0.0, 0.0], [1.1, 0.0, 0.0]]])
        self._scene.add_line_segments(f"{name}/line", ends, colour, thickness=0.006)
        return frame

    def _build_target(self) -> Any:
        scene = self._scene
        target = scene.add_frame("/target", show_axes=False)
        scene.add_box("/target/plate", (70, 76, 86), (0.012, *ARMOR), position=(0.008, 0.0, 0.0))
        for name, y in (("left", 0.5), ("right", -0.5)):
            place = (0.0, y * (ARMOR[0] + 0.016), 0.0)
            scene.add_box(f"/target/light_{name}", (86, 180, 233), (0.02, 0.012, ARMOR[1]), position=place)
        scene.add_box("/target/pole", PALE, (0.02, 0.02, 0.36), position=(0.02, 0.0, -0.24))
        self._shots = self._points("/target/shots", 0.017)
        return target

    def _build_board(self) -> Any:
        scene, side = self._scene, 2.0 * BOARD_SCALE * BOARD_REACH
        board = scene.add_frame("/board", show_axes=False)
        # An image has no shades, a box would.
        facing = (0.5, 0.5, -0.5, -0.5)
        scene.add_image("/board/back", _board_picture(), side, side, wxyz=facing, position=(0.02, 0.0, 0.0))
        self._ellipse = scene.add_line_segments(
            "/board/ellipse", self._board_ring(0.01, 0.01), (0, 158, 115), thickness=0.014
        )
        self._enlarged = self._points("/board/shots", 0.042)
        scene.add_label(
            "/board/title",
            f"armor ×{BOARD_SCALE:g}: circle = hit, ellipse = 95 % of the dispersion",
            position=(0.0, 0.0, side / 2 + 0.03),
            anchor="bottom-center",
        )
        return board

    def _points(self, name: str, size: float) -> Any:
        nothing = np.array([_HIDDEN], np.float32)
        return self._scene.add_point_cloud(
            name, nothing, MISS, point_size=size, point_shape="circle", precision="float32", point_shading="flat"
        )

    @staticmethod
    def _board_ring(y: float, z: float) -> Floats:
        return _ring(BOARD_SCALE * y, BOARD_SCALE * z, -0.04)

    def arrange(self, distance: float, hit_radius: float, spread: Floats) -> None:
        """Put the board beside a target's way, and draw hit circle and dispersion ellipse of a perfect aim.

        Args:
          distance: of the target [m].
          hit_radius: largest miss that hits [m].
          spread: standard deviation of the dispersion angles, pitch and yaw [rad], shape (2,).
        """
        self._board.position = x, y, z = distance + 0.6, 1.45, 0.85
        self._caption.position = (x, y, z + BOARD_SCALE * BOARD_REACH + 0.2)
        up, left = (max(ELLIPSE_SCALE * distance * float(each), 1e-4) for each in spread)
        self._ellipse.points = self._board_ring(left, up).astype(np.float32)
        ring = _ring(hit_radius, hit_radius, -0.004)
        self._scene.add_line_segments("/target/circle", ring, (255, 255, 255), thickness=0.003)
        self._scene.add_line_segments("/board/circle", self._board_ring(hit_radius, hit_radius), INK, thickness=0.014)
        self._landed = self._in_flight = -1

    def show_target(self, visible: bool) -> None:
        """Show target and board, or hide them where there is none: in a recording."""
        self._target.visible = self._board.visible = visible

    def caption(self, text: str) -> None:
        """Say in the picture what is shown; an exported page has no other words."""
        if self._caption.text != text:
            self._caption.text = text

    def point_gimbal(self, angle: Floats, command: Floats) -> None:
        """Turn the gimbal, and the ray of its command.

        Args:
          angle: pitch and yaw [rad], shape (2,).
          command: pitch and yaw [rad], shape (2,).
        """
        self._yaw.wxyz = turn(0.0, float(angle[1]))
        self._pitch.wxyz = turn(float(angle[0]), 0.0)
        self._command.wxyz = turn(*(float(each) for each in command))

    def draw(self, shown: Moment) -> None:
        """Draw a moment of an engagement."""
        self.point_gimbal(shown.angle, shown.command)
        self._target.position = tuple(float(each) for each in shown.place)
        flying = shown.pellets[-MOST_PELLETS:]
        if len(flying) or self._in_flight != 0:
            self._pellets.colors = np.array(PELLET, np.uint8)
            self._pellets.points = flying.astype(np.float32) if len(flying) else np.array([_HIDDEN], np.float32)
        self._in_flight = len(flying)
        if len(shown.misses) != self._landed:
            self._draw_shots(shown.misses, shown.hit)

    def _draw_shots(self, misses: Floats, hit: NDArray[np.bool_]) -> None:
        self._landed = len(misses)
        colours = np.where(hit[:, None], HIT, MISS).astype(np.uint8)
        for cloud, scale, reach in ((self._shots, 1.0, 1.5), (self._enlarged, BOARD_SCALE, BOARD_REACH)):
            kept = scale * np.clip(misses, -reach, reach)
            points = np.concatenate([np.full((len(kept), 1), -0.01), kept], axis=1).astype(np.float32)
            cloud.points = points if len(points) else np.array([_HIDDEN], np.float32)
            cloud.colors = colours if len(points) else np.array([MISS], np.uint8)


def turn(pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return the quaternion (w, x, y, z) of a gimbal; our pitch turns against the right-handed sense about y.

    Args:
      pitch: muzzle up positive [rad].
      yaw: left positive [rad].
    """
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(-pitch / 2), math.sin(-pitch / 2)
    return (cy * cp, -sy * sp, cy * sp, sy * cp)


def _segments(points: Floats) -> Floats:
    return np.stack([points[:-1], points[1:]], axis=1)


def _ring(y: float, z: float, x: float, corners: int = 48) -> Floats:
    """Line segments of an ellipse in the plane of an armor, shape (corners, 2, 3)."""
    angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    return _segments(np.stack([np.full(corners + 1, x), y * np.cos(angle), z * np.sin(angle)], axis=-1))


def _board_picture(pixels: int = 280) -> NDArray[np.uint8]:
    """Paper with an edge, and the armor on it, shape (pixels, pixels, 3)."""
    picture = np.full((pixels, pixels, 3), 252, np.uint8)
    away = np.abs((np.arange(pixels) + 0.5) * 2 * BOARD_REACH / pixels - BOARD_REACH)
    plate = (away[:, None] <= ARMOR[1] / 2) & (away[None, :] <= ARMOR[0] / 2)
    picture[plate] = PALE
    for edge in (0, 1, 2, -1, -2, -3):
        picture[edge], picture[:, edge] = STEEL, STEEL
    return picture


def look_from(camera: Any, view: str, distance: float) -> None:
    """Put a camera to a viewpoint.

    Args:
      camera: of a client, or the first one of all.
      view: one of `VIEWPOINTS`.
      distance: of the target [m].
    """
    place, towards = VIEWPOINTS[view](distance)
    camera.position, camera.look_at, camera.fov = place, towards, FIELD_OF_VIEW
