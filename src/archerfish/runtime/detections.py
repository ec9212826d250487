"""Detections of a robot's camera program: lines of JSON, each a frame with its stamp and the plates that it shows."""

from typing import Annotated, Literal

import msgspec
from msgspec import Meta

_Metres = Annotated[float, Meta(ge=-100.0, le=100.0)]


class CameraFrame(msgspec.Struct, frozen=True):
    """A frame; bounds refuse NaN, too."""

    stamp: Annotated[float, Meta(ge=-1e12, le=1e12)]
    """When it was exposed, on the camera's clock [s]."""
    plates: Annotated[list[tuple[_Metres, _Metres, _Metres]], Meta(max_length=32)]
    """Centres of the plates [m]: x forward, y left, z up. The first one is aimed at."""
    frame: Literal["camera", "gimbal", "world"] = "camera"
    """Where these are: from the camera, from the gimbal's pivot along its axes, or from the pivot in frame O."""


_DECODER = msgspec.json.Decoder(CameraFrame)


def camera_frames(data: bytes) -> list[CameraFrame] | None:
    """Return the frames in lines of JSON; None where a line is not as expected."""
    try:
        return _DECODER.decode_lines(data)
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
        return None
