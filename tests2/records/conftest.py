import copy
import json
import random
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from archerfish2.errors import InputError
from archerfish2.paper.gimbal import printed_plants
from archerfish2.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish2.robot import PartVerdict, Robot

NAN, HUGE = float("nan"), 10**400
ODD: Any = [None, True, "1", -1, 0, 1, 2.5, 1e308, -1e13, HUGE, NAN, [], {}, [[[1.0]]], "\ud800\n", [1.0] * 1000]
STRANGE = (b"", b"[]", b"1", b"null", b"\x00" * 1000, b"[" * 50_000, b'{"a":' * 50_000, b'{"schema":[' * 50_000)
NOISE = ("time_offset", "stamp_jitter", "bearing_sd", "elevation_sd", "range_sd", "miss_probability", "outlier_share")


@pytest.fixture(scope="session")
def robot() -> Robot:
    """A robot that has everything: draws with delays of their own, sensing, verdicts."""
    plants: Any = printed_plants()
    for axis, plant in plants.items():
        draws = {name: np.repeat(getattr(plant, name)[None], 3, axis=0) for name in "ABCD"}
        plants[axis] = plant.replace(draws=draws, draw_delays=np.arange(3))
    camera = CameraRecord(rate_hz=60.0, noise_range=3.0, **dict.fromkeys(NOISE, 0.1))
    sensing = SensingRecord(camera=camera, link=LinkRecord(feedback_rate_hz=500.0, command_latency=0.01))
    parts = {"pitch": PartVerdict(usable=True, headline="fits"), "yaw": PartVerdict(usable=False, headline="drifts")}
    paper = Robot.paper()
    muzzle = paper.muzzle.replace(intervals={"speed": (17.9, 18.1)})
    return paper.replace(name="mine", **plants, muzzle=muzzle, sensing=sensing, assumed=("muzzle",), parts=parts)


def _places(content: Any) -> list[tuple[Any, Any]]:
    keys: Any = list(content) if isinstance(content, dict) else range(len(content)) if isinstance(content, list) else ()
    return [(content, key) for key in keys] + [place for key in keys for place in _places(content[key])]


def _mutated(content: bytes, draw: random.Random) -> bytes:
    kind = draw.choice(("cut", "flip", "strange", "retype", "retype", "scale", "scale", "scale", "remove", "double"))
    if kind == "strange":
        return draw.choice((*STRANGE, content * 2))
    if kind in ("cut", "flip"):
        changed = bytearray(content)
        changed[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        return bytes(changed if kind == "flip" else changed[: draw.randrange(len(content))])
    root = json.loads(content)
    for _ in range(draw.choice((1, 1, 2, 5))):
        places = _places(root)
        numbers = [place for place in places if kind == "scale" and type(place[0][place[1]]) is float]
        parent, key = draw.choice(numbers or places or [([0.0], 0)])
        parent[key] = parent[key] * draw.choice((-1, 0, 0.999, 2, 1e9)) if numbers else copy.deepcopy(draw.choice(ODD))
        if kind == "remove":
            del parent[key]
    text = json.dumps(root)
    return (text[:-1] + "," + text[1:] if kind == "double" else text).encode()


@pytest.fixture(scope="session")
def mutations() -> Callable[[bytes, int, int], list[bytes]]:
    """Make mutated contents of a JSON file: mutations(content, count, seed)."""
    return lambda content, count, seed: [_mutated(content, random.Random(f"{seed} {each}")) for each in range(count)]


@pytest.fixture(scope="session")
def accepted() -> Callable[[Callable[[], Any]], Any]:
    """Check that a reader refuses a file in one line, or returns something, within a second and 200 MB; return that."""

    def check(read: Callable[[], Any]) -> Any:
        tracemalloc.start()
        started, result = time.process_time(), None
        try:
            result = read()
        except InputError as error:
            assert "\n" not in str(error)
        spent = time.process_time() - started, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert (spent[0] < 1.0, spent[1] < 200e6) == (True, True)
        return result

    return check
