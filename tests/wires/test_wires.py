"""Wires: published frames decode and encode exactly, and what a line does to bytes costs no other frame."""

import functools
import itertools
import json
import math
import random
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from archerfish.wires import Layout, Stream, load_wire
from archerfish.wires.stream import WireFrame
from archerfish.wires.wire import WireCommand, in_range

TENTH = "*0.0017453292519943296"
EP = ["= 55 15 04", "crc ep8", "route u16", "sequence u16", "= 00 04 0C", f"yaw_rate i16 {TENTH}", "roll_rate i16"]
EP += [f"pitch_rate i16 {TENTH}", "reserved u16", "crc ep16"]
WHEELS = ["= AA 16 00 00 00 02 00 00", "sequence u16", "crc roborts16", "= 04 03", "wheels u16 x2", "crc roborts32"]
GOLDEN = "data/robomaster/protocol_golden_frames.json"
ANGLES = {"pitch": math.radians(-5), "yaw": math.radians(10)}
PUBLISHED = [  # wire, frame, begin of the name in the file, numbers
    ("sp_vision_25", "command", "VisionToGimbal", {"mode": 1, "yaw": 0.1, "pitch": 0.05, "yaw_acceleration": 0.3}),
    ("sp_vision_25", "feedback", "GimbalToVision", {"mode": 1, "yaw_rate": 0.2, "muzzle_speed": 22.5, "shots": 7}),
    ("rm_vision", "feedback", "MCU->PC", {"pitch": 0.05, "yaw": 0.1, "aim": [3, 0, 0.2]}),
    ("rm_vision", "target", "PC->MCU", {"position": [3, 0, 0.2], "velocity": [0.5, 0, 0], "radius_2": 0.25}),
    ("roborts", "command", "set_gimbal_angle", ANGLES),
    ("roborts", "shoot", "shoot once", {"kind": 1, "count": 1, "frequency": 1500, "sequence": 1}),
    ("roborts", "heartbeat", "heartbeat", {"state": 0, "sequence": 2}),
    ("roborts", "feedback", "gimbal_info", {**ANGLES, "yaw_rate": math.radians(1.2), "pitch_rate": math.radians(-0.7)}),
]
REFEREE = [
    ("heat", 0x0202, struct.pack("<HHfHHHH", 0, 0, 0.0, 60, 123, 0, 0), {"buffer_energy": 60, "shots_left": 7.7}),
    ("shot", 0x0207, struct.pack("<BBBf", 1, 1, 12, 22.5), {"shots_per_s": 12, "muzzle_speed": 22.5}),
]


def bitwise(data, size, polynomial, value):
    """Return a checksum bit by bit, with the polynomial as it is printed, and bits in the order of the line."""
    top = 1 << 8 * size
    value = int(f"{value:0{8 * size}b}"[::-1], 2)
    for byte in data:
        for bit in range(8):
            value = value << 1 ^ ((byte >> bit & 1) << 8 * size)
            value = value ^ top ^ polynomial if value & top else value
    return int(f"{value:0{8 * size}b}"[::-1], 2).to_bytes(size, "little")


def referee_frame(command, data):
    head = struct.pack("<BHB", 0xA5, len(data), 9)
    head += bitwise(head, 1, 0x31, 0xFF) + struct.pack("<H", command) + data
    return head + bitwise(head, 2, 0x1021, 0xFFFF)


@pytest.fixture(scope="module")
def frames(shared):
    """Return layout, bytes and numbers of each published frame, and of two of the referee system."""
    stored = json.loads(shared(GOLDEN).read_text())
    texts = {
        name: text
        for one in ("sp_vision_25", "rm_serial_driver", "roborts")
        for name, text in stored[one]["frames"].items()
    }
    rates, ep = {"yaw_rate": math.radians(30), "pitch_rate": math.radians(-10)}, stored["robomaster_ep"]["frames"]
    found = [(Layout("speed", EP), bytes.fromhex(*ep.values()), rates)]
    wheels = bytes.fromhex(stored["roborts"]["frames"]["fric 1240/1240 seq3"])
    found.append((Layout("wheels", WHEELS), wheels, {"wheels": [1240, 1240], "sequence": 3}))
    for wire, frame, begin, numbers in PUBLISHED:
        [text] = [text for name, text in texts.items() if name.startswith(begin)]
        found.append((load_wire(wire).layouts[frame], bytes.fromhex(text), numbers))
    layouts = load_wire("referee").layouts
    return found + [(layouts[name], referee_frame(command, data), numbers) for name, command, data, numbers in REFEREE]


def test_published_frames_decode_and_encode_exactly(frames):
    for layout, data, numbers in frames:
        values = layout.decode(data)
        assert layout.is_valid(data), layout
        assert {name: values[name] for name in numbers} == {
            name: pytest.approx(value, rel=1e-6, abs=1e-6) for name, value in numbers.items()
        }
        assert layout.encode(values) == data


def test_every_flipped_bit_is_noticed(frames):
    for layout, data, _ in frames:
        for bit in range(8 * len(data)):
            flipped = int.from_bytes(data, "little") ^ 1 << bit
            assert not layout.is_valid(flipped.to_bytes(len(data), "little")), (layout, bit)


FEEDBACK = load_wire("sp_vision_25").received[0]
HEADS = struct.unpack("<f", b"SPSP")[0]


def numbered(number, heads=False):
    """Return a report, its number in it; with the bytes of its head all over its numbers."""
    return FEEDBACK.encode({"mode": 1, "quaternion": [HEADS * heads] * 4, "yaw": HEADS * heads, "shots": number})


def parts(data, rng):
    """Divide bytes at random."""
    while data:
        size = rng.randrange(1, 90)
        yield data[:size]
        data = data[size:]


DAMAGE = {
    "a bit": lambda frame, place, rng: (
        frame[:place] + bytes([frame[place] ^ 1 << rng.randrange(8)]) + frame[place + 1 :]
    ),
    "a byte less": lambda frame, place, rng: frame[:place] + frame[place + 1 :],
    "a byte more": lambda frame, place, rng: frame[: place + 1] + rng.randbytes(1) + frame[place + 1 :],
    "the end": lambda frame, place, rng: frame[:place],
    "noise before": lambda frame, place, rng: rng.randbytes(place) + frame,
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_damage_costs_the_frame_that_it_is_in_at_most(kind):
    rng, data, damaged = random.Random(1), b"", {*range(5, 400, 10)}
    for number in range(400):
        frame = numbered(number, heads=rng.random() < 0.3)
        data += DAMAGE[kind](frame, rng.randrange(len(frame)), rng) if number in damaged else frame
    stream = Stream([FEEDBACK])
    got = [FEEDBACK.decode(frame.data)["shots"] for part in parts(data, rng) for frame in stream.feed(part)]
    assert {*range(400)} - {*got} <= (damaged if kind != "noise before" else set())
    assert got == sorted(got)


@pytest.mark.parametrize("wires", [("sp_vision_25", "referee"), ("roborts",), ("rm_vision",)])
def test_noise_makes_no_message(wires):
    wire, noise = load_wire(*wires), random.Random(3).randbytes(300_000)
    stream = Stream(wire.received)
    frames = [frame for part in parts(noise, random.Random(4)) for frame in stream.feed(part)]
    assert not in_range(wire.decode(frames).feedback).any()
    assert len(stream._bytes) < max(layout.length for layout in wire.received)


@functools.cache
def mixed():
    """Return two seconds of a line: frames of several kinds, noise, and parts of frames."""
    rng, wire = random.Random(5), load_wire("sp_vision_25", "referee")
    shot = wire.layouts["shot"].encode({"muzzle_speed": 15.0})
    pieces = [
        numbered(number, heads=True) + rng.choice([b"", b"SP", shot, shot[:9], rng.randbytes(30)])
        for number in range(20)
    ]
    return wire, b"".join(pieces)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.integers(0, 1400), max_size=12))
def test_frames_are_the_same_however_the_bytes_arrive(cuts):
    wire, data = mixed()
    whole, divided = Stream(wire.received), Stream(wire.received)
    places = [0, *sorted(cuts), len(data)]
    found = [frame for low, high in itertools.pairwise(places) for frame in divided.feed(data[low:high])]
    assert found == whole.feed(data)
    assert (len([*found]) > 20, divided.rejected) == (True, whole.rejected)


def test_a_command_is_sent_in_the_frames_of_its_state():
    sent = [WireCommand(np.array([0.05, 0.1]), *state) for state in ((False, True), (True, False), (True, True))]
    for name, kinds in {
        "sp_vision_25": [["command"]] * 3,
        "roborts": [["heartbeat"], ["command", "heartbeat"], ["command", "shoot", "heartbeat"]],
    }.items():
        wire = load_wire(name)
        frames = Stream(wire.layouts.values()).feed(b"".join(map(wire.encode, sent)))
        assert [frame.layout.name for frame in frames] == [kind for each in kinds for kind in each]
        modes = [frame.layout.decode(frame.data).get("mode") for frame in frames]
        assert modes == ([0, 1, 2] if name == "sp_vision_25" else [None] * 6)
        yaws = [value["yaw"] for frame in frames if "yaw" in (value := frame.layout.decode(frame.data))]
        np.testing.assert_allclose(yaws, [*[0.0] * (name == "sp_vision_25"), 0.1, 0.1], atol=1e-3)


def report_of(wire, **numbers):
    """Return a frame with a report of some numbers."""
    layout = wire.layouts[wire.report]
    return WireFrame(layout, layout.encode(numbers))


def test_reports_carry_the_latest_reading_of_the_referee():
    wire = load_wire("sp_vision_25", "referee")
    report = FEEDBACK.encode({"mode": 0, "yaw": -0.2, "pitch": 0.1, "pitch_rate": 0.3, "muzzle_speed": 14.0})
    data = report + wire.layouts["heat"].encode({"shots_left": 3.0}) + numbered(1)
    reports = wire.decode(Stream(wire.received).feed(data))
    np.testing.assert_allclose(reports.feedback.angle[0], [0.1, -0.2], rtol=1e-6)
    np.testing.assert_allclose(reports.feedback.rate[0], [0.3, 0.0], rtol=1e-6)
    assert reports.switch_on.tolist() == [False, True]
    np.testing.assert_allclose(reports.shots_left, [np.nan, 3.0])


def test_the_chassis_turns_by_what_the_encoder_does_not_see():
    wire, yaws, encoders = load_wire("roborts"), np.array([0.5, -3.0, 3.1, 1.0]), np.array([0.2, 3.0, -3.1, 1.0])
    reports = wire.decode(
        [report_of(wire, yaw=yaw, yaw_encoder=encoder) for yaw, encoder in zip(yaws, encoders, strict=True)]
    )
    turned = [0.3, 2.0 * np.pi - 6.0, 6.2 - 2.0 * np.pi, 0.0]
    np.testing.assert_allclose(reports.base_yaw, turned, atol=2 * np.radians(0.1))
    plain = load_wire("sp_vision_25")
    assert (wire.has_base_yaw, plain.has_base_yaw) == (True, False)
    np.testing.assert_array_equal(plain.decode([report_of(plain, yaw=0.5)]).base_yaw, [np.nan])


def test_a_team_gives_a_wire_of_its_own(tmp_path):
    text = "from archerfish.wires import load_wire\nclass Ours:\n  received = load_wire('roborts').received\n"
    text += "  def decode(self, frames): return load_wire('roborts').decode(frames)\n"
    text += "  def encode(self, sent): return b'!'\n"
    (tmp_path / "ours.py").write_text(text)
    assert load_wire(f"{tmp_path}/ours.py:Ours").encode(None) == b"!"


@pytest.mark.parametrize(
    "text, pattern",
    [
        ("[a]\nfields = ['= 01']\nspeed = 1", r"mine\.toml: .*speed"),
        ("[a]\nfields = ['yaw f32']", r"mine\.toml: field a\.fields: a frame begins with constant bytes"),
        ("[a]\nfields = ['= 01', 'yaw f16']", r"field a\.fields: entry 2, 'yaw f16': expected .*f32"),
        ("[a]\nfields = ['= 01', 'crc mcrf4x']", r"no such checksum; perhaps you meant mcrf4xx"),
        ("[a]\nfields = ['= 01', 'yaw f32', 'yaw u8']", r"a name is there once"),
        ("[a]\nfields = ['= 01', 'mode u8']\nsent.fire = { mode = 256 }", r"no room for mode \[256"),
        ("[a]\nfields = ['= 01', 'mode u8']\nswitch_on = { mod = 1 }", r"no number mod; perhaps you meant mode"),
        ("[a\n", r"mine\.toml: is not TOML .*; correct that place"),
        ("[a]\nfields = ['= 01', 3]", r"field a\.fields\[1\]: expected str, got int"),
        ("a = 1", r"field a: expected object, got int"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused(text, pattern, tmp_path, refused):
    (tmp_path / "mine.toml").write_text(text)
    refused(pattern, load_wire, tmp_path / "mine.toml")


def test_a_wire_without_a_direction_is_refused(tmp_path, refused):
    report = "[up]\nfields = ['= 01', 'pitch f32', 'yaw f32', 'pitch_rate f32', 'yaw_rate f32', 'on u8']\n"
    down, sent = "[down]\nfields = ['= 02', 'mode u8']\n", "sent.control = {mode = 1}\n"
    fire, idle = "sent.fire = {mode = 2}\n", "sent.idle = {mode = 0}\n"
    texts = {
        "no frame has pitch, yaw, pitch_rate, yaw_rate, expected a report; join": down + sent,
        r"switch_on is in other, expected it in up": report + down + sent + "[other]\n" + "fields = ['= 03', 'on u8']\n"
        "switch_on = {on = 1}",
        "no frame has sent.control, expected a command": report,
        "no sent.fire differs from its sent.control": report + down + sent + idle + "sent.fire = {mode = 1}",
        "no frame has sent.idle, so the gimbal could not be let go": report + down + sent + fire,
    }
    for pattern, text in texts.items():
        (tmp_path / "mine.toml").write_text(text)
        refused(f"wire mine: {pattern}", load_wire(tmp_path / "mine.toml").check_complete)


WHOLE = """
[report]
fields = ["= 01", "switch u8", "pitch f32", "yaw f32", "pitch_rate f32", "yaw_rate f32"]

[command]
fields = ["= 02", "mode u8", "pitch f32", "yaw f32"]
sent.idle = { mode = 0 }
sent.control = { mode = 1 }
sent.fire = { mode = 2 }
"""


@pytest.mark.parametrize(
    "old, new, pattern",
    [
        ('mode u8", "pitch', 'mode u8", "pich', "frame command has no pitch; for pich perhaps you meant pitch$"),
        ('mode u8", "pitch f32", "yaw f32"', 'mode u8", "pitch f32"', "frame command has no yaw; add what is missing$"),
        (
            'mode u8", "pitch f32", "yaw f32"',
            'mode u8"',
            "no frame with sent.control has pitch, yaw, expected a command",
        ),
        ('switch u8", "pitch', 'switch u8", "pich', "frame report has no pitch; for pich perhaps you meant pitch$"),
        (
            '"pitch f32", "yaw f32", "pitch_rate',
            '"yaw f32", "pitch_rate',
            "frame report has no pitch; add what is missing$",
        ),
        (
            '"pitch_rate f32", "yaw_rate',
            '"pitchrate f32", "yawrate',
            ".* pitch_rate, yaw_rate; for pitchrate perhaps you meant pitch_rate, for yawrate .* yaw_rate$",
        ),
        (', "pitch_rate f32", "yaw_rate f32"', "", "frame report has no pitch_rate, yaw_rate; add what is missing$"),
        ("sent.idle = { mode = 0 }", "sent.idle = { mode = 1 }", "sent.idle is the same as another state"),
        ("sent.idle = { mode = 0 }", "sent.idle = { mode = 2 }", "sent.idle is the same as another state"),
        (
            "sent.fire = { mode = 2 }",
            "[shoot]\nfields = ['= 03']\nsent.fire = {}",
            "no frame with sent.fire has pitch, yaw, expected the angles, too; add sent.fire to their frame",
        ),
    ],
)
def test_a_wire_whose_commands_or_reports_lack_angles_is_refused(old, new, pattern, tmp_path, refused):
    (tmp_path / "mine.toml").write_text(WHOLE)
    load_wire(tmp_path / "mine.toml").check_complete()
    assert WHOLE.count(old) == 1
    (tmp_path / "mine.toml").write_text(WHOLE.replace(old, new))
    refused(f"wire mine: {pattern}", load_wire(tmp_path / "mine.toml").check_complete)


def test_a_state_or_a_line_of_a_frame_that_there_is_not_is_named_with_those_that_there_are(tmp_path, refused):
    for old, new, pattern in (
        (
            "sent.idle",
            "sent.idel",
            r"field command\.sent: .*'idel', expected one of idle, control, fire; .* idle",
        ),
        ("[command]\nfields", "[command]\nfeilds", "field command: .*unknown field feilds; perhaps you meant fields"),
        ("[command]", "[command]\nendian = 'Big'", r"field command\.endian: .*'Big', expected one of little, big"),
    ):
        (tmp_path / "mine.toml").write_text(WHOLE.replace(old, new))
        refused(pattern, load_wire, tmp_path / "mine.toml")


def test_a_file_of_code_needs_the_name_of_its_wire(tmp_path, refused):
    path = tmp_path / "ours.py"
    path.write_text("class Half:\n  received = ()\n")
    refused(rf"add :NAME, as {path}:NAME", load_wire, path)
    refused(r"ours\.py:Half: Half has no decode, encode, expected a wire", load_wire, f"{path}:Half")
    refused(r"has no 'Whole', but Half", load_wire, f"{path}:Whole")


def test_an_unknown_wire_and_a_number_without_room_are_refused(refused):
    refused("perhaps you meant roborts", load_wire, "robort")
    layout = Layout("a", ["= 01", "angle i16 *0.001"], "big")
    assert layout.encode({"angle": -0.258}) == bytes.fromhex("01fefe")
    for value in (40.0, math.nan, math.inf):
        refused("no room for angle", layout.encode, {"angle": value})
