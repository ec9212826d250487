"""What strangers at the websocket can do to the page: raw messages to a real server, with no browser between."""

import asyncio
import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest

pytest.importorskip("viser", reason="needs viser, the extra view")

import msgspec
import viser
import zstandard
from websockets.asyncio.client import connect

from archerfish.viewer.choice import Choice, Subject
from archerfish.viewer.messages import LONGEST_BYTES, is_acceptable
from archerfish.viewer.motions import HAND
from archerfish.viewer.page import TrialPage
from archerfish.viewer.server import close_server, open_server
from archerfish.viewer.turning import keep_turning

HUGE = "1" + "0" * 400
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0, 0, 0],
    "position": [0, 0, 1],
    "fov": 1.0,
    "near": 0.01,
    "far": 100,
    "image_height": 100,
    "image_width": 100,
    "look_at": [1, 0, 0],
    "up_direction": [0, 0, 1],
}


class Open(NamedTuple):
    """A page with its thread."""

    server: Any
    page: TrialPage
    thread: threading.Thread

    def control(self, label: str) -> Any:
        handles = self.server.gui._gui_input_handle_from_uuid.values()
        return next(each for each in handles if each.label == label)

    def update(self, label: str, **updates: Any) -> dict[str, Any]:
        return {"type": "GuiUpdateMessage", "uuid": self.control(label)._impl.uuid, "updates": updates}


@pytest.fixture(scope="module")
def opened(subject: Subject, choice: Choice) -> Iterator[Open]:
    server, stop = open_server("127.0.0.1", 0, "test"), threading.Event()
    page = TrialPage(server, subject, choice, "kalman-lq")
    thread = threading.Thread(target=keep_turning, args=(server, page, stop), daemon=True)
    thread.start()
    yield Open(server, page, thread)
    stop.set()
    thread.join()
    close_server(server)


def say(opened: Open, *messages: dict[str, Any] | bytes | str, until: Callable[[], bool] = lambda: True) -> str:
    """Send messages as a client, wait until they arrived, and return all that the server sent, as text."""

    async def talk() -> str:
        address = f"ws://127.0.0.1:{opened.server.get_port()}"
        heard = ""
        async with connect(address, subprotocols=[f"viser-v{viser.__version__}"], max_size=None) as socket:
            await socket.send(msgspec.msgpack.encode(CAMERA))
            for each in messages:
                await socket.send(msgspec.msgpack.encode(each) if isinstance(each, dict) else each)
            limit, least = time.monotonic() + 20.0, time.monotonic() + 0.4
            while time.monotonic() < least or (not until() and time.monotonic() < limit):
                try:
                    frame = await asyncio.wait_for(socket.recv(), 0.1)
                except TimeoutError:
                    continue
                assert isinstance(frame, bytes)
                length = int.from_bytes(frame[8:16], "little")
                heard += str(msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(frame[16 : 16 + length])))
        return heard

    heard = asyncio.run(talk())
    assert until()
    assert opened.thread.is_alive()
    return heard


def values(opened: Open) -> dict[str, Any]:
    return {each.label: each.value for each in opened.server.gui._gui_input_handle_from_uuid.values()}


def test_a_client_uses_the_controls_as_they_are_offered(opened: Open) -> None:
    slider = opened.control("Distance [m]")
    say(opened, opened.update("Distance [m]", value=5), until=lambda: slider.value == 5.0)
    say(
        opened,
        opened.update("Controller", value="oracle"),
        until=lambda: "oracle" in opened.page._controls._told.content,
    )
    say(opened, opened.update("New engagements", value=True), until=lambda: opened.page._choice.seed == 1)


def test_what_a_control_does_not_offer_is_dropped_and_the_page_goes_on(opened: Open) -> None:
    wrong: list[tuple[str, dict[str, Any]]] = [
        ("Time [s]", {"props": 5}),
        ("Time [s]", {"removed": True}),
        ("Time [s]", {"value": math.nan}),
        ("Time [s]", {"value": math.inf}),
        ("Time [s]", {"value": 0.1, "removed": True}),
        ("Added command latency [ms]", {"value": HUGE}),
        ("Added command latency [ms]", {"value": 1e30}),
        ("Distance [m]", {"value": 2**63}),
        ("Distance [m]", {"value": 9.0}),
        ("Distance [m]", {"value": "2"}),
        ("Distance [m]", {"value": True}),
        ("Distance [m]", {"value": [2.0]}),
        ("Distance [m]", {}),
        ("Target", {"value": "<iframe srcdoc=x>"}),
        ("Target", {"value": 5}),
        ("Pace", {"value": ["half"]}),
        ("View", {"value": "from nowhere"}),
        ("Pause", {"value": "yes"}),
    ]
    before = values(opened)
    heard = say(opened, *(opened.update(label, **updates) for label, updates in wrong))
    after, speed = values(opened), opened.control("Speed [m/s]")
    assert math.isfinite(after.pop("Time [s]"))
    assert all(after[label] == before[label] for label in after)
    assert "iframe" not in heard
    wanted = 1.5 if speed.value == 0.5 else 0.5
    say(opened, opened.update("Speed [m/s]", value=wanted), until=lambda: opened.page._choice.speed == wanted)


def test_a_target_is_dragged_to_places_alone(opened: Open) -> None:
    drag = {"type": "TransformControlsUpdateMessage", "name": "/hand", "owner": "", "wxyz": [1, 0, 0, 0]}
    nowhere: list[Any] = [["a"], [1.0, 2.0], [math.nan, 0, 0], [1e300, 0, 0], ["1", "2", "3"], 5, [[1.0], 0, 0]]
    hand_mode = (opened.update("Controller", value="kalman"), opened.update("Target", value=HAND))
    say(opened, *hand_mode, until=lambda: opened.page._run is not None)
    place, hand = [3.0, 0.5, 0.1], opened.page._gizmo
    say(opened, {**drag, "position": place}, until=lambda: list(hand.position) == place)
    say(opened, *({**drag, "position": each} for each in nowhere))
    assert list(hand.position) == place


def test_what_is_no_message_is_dropped() -> None:
    nothing: Callable[[str], Any] = lambda _: None  # noqa: E731
    assert is_acceptable(msgspec.msgpack.encode(CAMERA), nothing)
    for said in (
        "text",
        b"",
        b"\xc1",
        b"\x91" * 3000,
        msgspec.msgpack.encode([1]),
        msgspec.msgpack.encode({"type": ["GuiUpdateMessage"]}),
        msgspec.msgpack.encode({**CAMERA, "fov": None}),
        msgspec.msgpack.encode({**CAMERA, "more": 1}),
        msgspec.msgpack.encode({**CAMERA, "position": [0, 0]}),
        msgspec.msgpack.encode({"type": "GuiUpdateMessage", "uuid": "unknown", "updates": {"value": 1}}),
        msgspec.msgpack.encode({"type": "GuiFormDirtyMessage", "uuid": "x"}),
        msgspec.msgpack.encode({"type": "FileTransferStartUpload"}),
        msgspec.msgpack.encode({"type": "ShareUrlRequest"}),
        b"\x81" + msgspec.msgpack.encode({"a": 1}) + b"\x01",
        bytes(LONGEST_BYTES + 1),
    ):
        assert not is_acceptable(said, nothing), said[:40]


@pytest.mark.parametrize("value", [math.nan, "x", None, HUGE, 10**400])
def test_the_page_outlives_a_value_that_got_past_the_guard(subject: Subject, choice: Choice, value: Any) -> None:
    server = open_server("127.0.0.1", 0, "test")
    try:
        page = TrialPage(server, subject, choice, "kalman-lq")
        speed, motion, stands = page._controls._speed, page._controls._motion, page._player._slider
        speed._impl.value, motion._impl.value, stands._impl.value = value, value, math.nan
        page._changed.set()
        page.turn(0.1)
        assert re.search("Not possible.*must be", page._controls._told.content)
        speed._impl.value, motion._impl.value = 0.5, choice.motion
        page._changed.set()
        page.turn(0.1)
        page.turn(0.1)
        assert "Not possible" not in page._controls._told.content
        assert math.isfinite(stands.value)
    finally:
        close_server(server)
