"""What a client may say to the page: use a control as it is offered, drag the target, look from somewhere.

viser sets whatever attribute of a control a client names, to whatever value, and sends it on to everyone. So all that
comes in is looked at before viser reads it, and what no browser that shows the page would send is left out.
"""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import viser

LONGEST_BYTES = 4096
"""Of a message; those that pass take a few hundred."""
LARGEST = 1e5
"""Coordinate [m], or picture size [pixels], that passes."""
_LONGEST_WORD = 200
_ROUNDING = 1e-6


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST


def _is_row(length: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and len(value) == length and all(map(_is_number, value))


def _is_word(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST_WORD


def _is_update(value: Any) -> bool:
    return isinstance(value, dict) and list(value) == ["value"]


_DRAG = {"name": _is_word, "owner": _is_word}
_FIELDS: Mapping[str, Mapping[str, Callable[[Any], bool]]] = {
    "GuiUpdateMessage": {"uuid": _is_word, "updates": _is_update},
    "TransformControlsDragStartMessage": _DRAG,
    "TransformControlsUpdateMessage": {**_DRAG, "wxyz": _is_row(4), "position": _is_row(3)},
    "TransformControlsDragEndMessage": _DRAG,
    "ViewerCameraMessage": {
        **dict.fromkeys(("fov", "near", "far", "image_height", "image_width"), _is_number),
        **dict.fromkeys(("position", "look_at", "up_direction"), _is_row(3)),
        "wxyz": _is_row(4),
    },
}
"""Kind of message → its fields, all of them, and what they must be."""


def is_acceptable(raw: str | bytes, control: Callable[[str], Any]) -> bool:
    """Tell whether a message may reach the page.

    Args:
      raw: as it came.
      control: returns viser's handle of a control by its identifier, or None.
    """
    if isinstance(raw, str) or len(raw) > LONGEST_BYTES:
        return False
    try:
        said = msgspec.msgpack.decode(raw)
    except (msgspec.MsgspecError, ArithmeticError, RecursionError, TypeError, ValueError):
        return False
    if not isinstance(said, dict) or not isinstance(said.get("type"), str):
        return False
    fields = _FIELDS.get(said["type"])
    if fields is None or said.keys() != {"type", *fields}:
        return False
    if not all(fits(said[name]) for name, fits in fields.items()):
        return False
    return said["type"] != "GuiUpdateMessage" or _is_offered(control(said["uuid"]), said["updates"]["value"])


def _is_offered(handle: Any, value: Any) -> bool:
    """Tell whether a control has a value to offer; one of a kind that the page does not use has none."""
    if isinstance(handle, viser.GuiSliderHandle):
        return _is_number(value) and handle.min - _ROUNDING <= value <= handle.max + _ROUNDING
    if isinstance(handle, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in handle.options
    if isinstance(handle, viser.GuiCheckboxHandle):
        return isinstance(value, bool)
    return isinstance(handle, viser.GuiButtonHandle) and value is True
