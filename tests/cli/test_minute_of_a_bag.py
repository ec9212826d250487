"""A minute of a 1 kHz bag, as a robot records it, becomes a plant record and a page by one command."""

import json

import numpy as np
import pytest
from scipy.signal import lfilter

from archerfish.records.plant import read_plant

pytest.importorskip("rosbags")
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

TYPES, JOINTS = get_typestore(Stores.ROS2_HUMBLE), "sensor_msgs/msg/JointState"
COUNT = 60_000


def write_minute(path):
    """Yaw's command in `effort` (steps of 0.2 s) and its angle in `position`, beside a pitch that rests."""
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(-0.2, 0.2, COUNT // 200), 200)
    angle = lfilter([0, 0, 6e-4], [1, -1.95, 0.9506], command) + 1e-4 * rng.standard_normal(COUNT)
    header, stamp = TYPES.types["std_msgs/msg/Header"], TYPES.types["builtin_interfaces/msg/Time"]
    with Writer(path, version=9) as writer:
        connection = writer.add_connection("/joint_states", JOINTS, typestore=TYPES)
        for index, (u, y) in enumerate(zip(command, angle, strict=True)):
            top = header(stamp(index // 1000, index % 1000 * 10**6), "base")
            values = [np.array([0.0, each]) for each in (y, 0.0, u)]
            message = TYPES.types[JOINTS](top, ["pitch", "yaw"], *values)
            writer.write(connection, index * 10**6, TYPES.serialize_cdr(message, JOINTS))


def test_a_minute_of_a_1_khz_bag_is_identified_by_one_command(command, tmp_path):
    write_minute(tmp_path / "bag")
    columns = ["--input", "/joint_states/yaw/effort", "--output", "/joint_states/yaw/position"]
    quick = ["--order", "2", "--max-delay", "4"]
    words = ["bag", *columns, *quick, "--axis", "yaw", "--out", "out", "--json", "facts.json"]
    status, out, err = command("identify", "gimbal", *words)
    assert (status, err) == (0, "")
    assert out.startswith("yaw: 2nd order")
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert facts["usable"]
    assert facts["training"][0]["fit_percent"] > 98
    plant = read_plant(tmp_path / "out" / "yaw.json")
    assert plant.sample_period_s == pytest.approx(1e-3)
    # z² − 1.95 z + 0.9506 = (z − 0.97) (z − 0.98)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(plant.A).real), [0.97, 0.98], atol=1e-3)
    assert "<h1>" in (tmp_path / "out" / "yaw.html").read_text()
