"""Frames in a stream of bytes, by a sliding window: damage costs the frame that it is in, and no other."""

import re
from collections.abc import Iterable
from typing import NamedTuple

from archerfish.wires.layout import Layout


class WireFrame(NamedTuple):
    """A valid frame."""

    layout: Layout
    data: bytes  # of the whole frame


class Stream:
    """Bytes that were received and belong to no frame yet; there are never more than the longest frame has."""

    def __init__(self, layouts: Iterable[Layout]) -> None:
        """Begin without bytes.

        Args:
          layouts: of the frames to find. Where several are valid at one place, the shortest is taken.
        """
        self._layouts = sorted(layouts, key=lambda layout: layout.length)
        heads = sorted({layout.head for layout in self._layouts})
        self._heads = re.compile(b"|".join(map(re.escape, heads)))
        self._longest_head = max(map(len, heads))
        self._bytes = b""
        self.rejected = 0
        """Places where a head was, but no valid frame."""

    def feed(self, data: bytes) -> list[WireFrame]:
        """Return the frames that are complete with bytes that arrived; the result is the same however they come."""
        received = self._bytes + data
        frames, place = list[WireFrame](), 0
        while found := self._heads.search(received, place):
            place = found.start()
            layout, is_complete = self._at(received, place)
            if not is_complete:
                break
            if layout:
                frames.append(WireFrame(layout, received[place : place + layout.length]))
            else:
                self.rejected += 1
            place += layout.length if layout else 1
        else:  # the end may be the begin of a head
            place = max(place, len(received) - self._longest_head + 1)
        self._bytes = received[place:]
        return frames

    def _at(self, received: bytes, place: int) -> tuple[Layout | None, bool]:
        """Return the layout of the frame at a place, if there is one, and whether enough bytes are there to say so."""
        for layout in self._layouts:
            if received.startswith(layout.head, place):
                if place + layout.length > len(received):
                    return None, False
                if layout.is_valid(received[place : place + layout.length]):
                    return layout, True
        return None, True
