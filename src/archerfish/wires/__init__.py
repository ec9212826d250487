"""Frames of bytes between a robot's microcontroller and the computer that aims, as tables of their fields."""

from archerfish.wires.layout import Layout
from archerfish.wires.stream import Stream
from archerfish.wires.wire import Wire, load_wire

__all__ = ["Layout", "Stream", "Wire", "load_wire"]
