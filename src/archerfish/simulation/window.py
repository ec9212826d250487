"""A window that shows pictures one after the other, where there is a display."""

import os
import sys
from typing import Any, cast

from archerfish.records.errors import InputError
from archerfish.simulation.picture import Picture


def has_display() -> bool:
    """Whether a window could be opened; on Linux that takes a server to open it on."""
    return sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


class Window:
    """A matplotlib window with one picture."""

    def __init__(self, title: str) -> None:
        """Prepare a window; it opens with the first picture.

        Raises:
          InputError: if none can be opened here.
        """
        remedy = 'take render_mode="rgb_array", which needs neither, and save or show its pictures yourself'
        if not has_display():
            raise InputError(f'render_mode "human" needs a display, and there is none; {remedy}')
        from matplotlib import pyplot
        from matplotlib.backends import registry

        backend, known = pyplot.get_backend(), cast(Any, registry)
        if backend.lower() not in known.backend_registry.list_builtin(known.BackendFilter.INTERACTIVE):
            raise InputError(
                f'render_mode "human" needs a toolkit of windows for matplotlib, whose backend is {backend}; install '
                f"one, for instance PyQt6, or {remedy}"
            )
        self._pyplot: Any = pyplot
        self._title = title
        self._figure: Any = None
        self._image: Any = None

    def show(self, picture: Picture) -> None:
        """Show a picture, shape (height, width, 3)."""
        if self._image is None:
            height, width, _ = picture.shape
            self._figure, axes = self._pyplot.subplots(figsize=(width / 100, height / 100), num=self._title)
            axes.set_axis_off()
            axes.set_position((0, 0, 1, 1))
            self._image = axes.imshow(picture)
        self._image.set_data(picture)
        self._pyplot.pause(1e-3)

    def close(self) -> None:
        """Close it; once is enough."""
        if self._figure is not None:
            self._pyplot.close(self._figure)
        self._figure = self._image = None
