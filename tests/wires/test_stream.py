"""Frames in a stream, byte by byte: damage is counted, costs no other frame, and no byte is kept that is not needed."""

import pytest

from archerfish.wires import Layout, Stream

LONG = Layout("long", ["= A1 B2 C3", "value u16", "crc mcrf4xx"])  # 7 bytes
SHORT = Layout("short", ["= D4", "value u8", "crc mcrf4xx"])  # 4 bytes


def values(frames):
    return [(frame.layout.name, frame.layout.decode(frame.data)["value"]) for frame in frames]


@pytest.mark.parametrize("layouts", [[LONG, SHORT], [SHORT, LONG]])
def test_a_frame_is_found_wherever_it_is_divided(layouts):
    data = b"\x00\xa1\x00" + LONG.encode({"value": 5}) + b"\x00\x00" + SHORT.encode({"value": 7}) + b"\xa1\xb2"
    for cut in range(len(data) + 1):
        stream = Stream(layouts)
        frames = stream.feed(data[:cut]) + stream.feed(data[cut:])
        assert (values(frames), stream.rejected, stream._bytes) == ([("long", 5), ("short", 7)], 0, b"\xa1\xb2")
    stream = Stream(layouts)
    frames = [frame for byte in data for frame in stream.feed(bytes([byte]))]
    assert values(frames) == [("long", 5), ("short", 7)]


def test_each_place_with_a_head_and_no_frame_is_counted_and_the_next_byte_may_begin_one():
    stream = Stream([SHORT])
    assert stream.rejected == 0
    assert values(stream.feed(b"\xd4" + SHORT.encode({"value": 1}))) == [("short", 1)]
    assert stream.rejected == 1
    assert values(stream.feed(b"\xd4\xd4" + SHORT.encode({"value": 2}) + SHORT.encode({"value": 3}))) == [
        ("short", 2),
        ("short", 3),
    ]
    assert stream.rejected == 3
    damaged = bytearray(SHORT.encode({"value": 4}))
    damaged[1] ^= 1
    assert values(stream.feed(bytes(damaged))) == []
    assert (stream.rejected, stream._bytes) == (4, b"")
    assert values(stream.feed(b"\xd4\x00\x00")) == []  # it may be one yet
    assert (stream.rejected, stream._bytes) == (4, b"\xd4\x00\x00")


def test_no_byte_is_kept_that_begins_no_head():
    stream = Stream([LONG])
    stream.feed(b"\x00" * 50)
    assert stream._bytes == b"\x00" * 2  # of a head of three bytes
    stream.feed(b"\x00\xa1")
    assert stream._bytes == b"\x00\xa1"


def test_of_two_frames_that_are_valid_at_one_place_the_shortest_is_taken():
    both = [Layout("more", ["= D4", "value u8 x1", "rest u8"]), Layout("less", ["= D4", "value u8"])]
    for layouts in (both, both[::-1]):
        frames = Stream(layouts).feed(b"\xd4\x01\x02")
        assert [(frame.layout.name, frame.data) for frame in frames] == [("less", b"\xd4\x01")]


def test_a_frame_of_one_head_is_not_taken_for_that_of_another_one():
    longer = Layout("longer", ["= D4 E5", "value u16", "crc mcrf4xx"])
    stream = Stream([longer, SHORT])
    assert values(stream.feed(longer.encode({"value": 300}) + SHORT.encode({"value": 9}))) == [
        ("longer", 300),
        ("short", 9),
    ]
    assert stream.rejected == 0
