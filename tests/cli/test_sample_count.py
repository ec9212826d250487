"""What was left out of logs is counted, and said in the verdict of every identification."""

import json

import numpy as np

from archerfish.cli.gimbal_logs import LogReading, read_gimbal_logs
from archerfish.cli.sample_count import count_samples, used_sentence
from archerfish.identification.axis.state_space import simulate
from archerfish.records.plant import PlantRecord

PERIOD = 0.01
POLE = 0.85 + 0.15j
A = np.array([[2 * POLE.real, 1.0], [-(abs(POLE) ** 2), 0.0]])
PLANT = PlantRecord(A, np.full((2, 1), 0.0225), np.array([[1.0, 0.0]]), np.zeros((1, 1)), 1, PERIOD)
READING = LogReading("time_s", ["u"], ["y"], None, 2, 3)


def rows(count=600, seed=0):
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-0.3, 0.3, count), rng.integers(5, 30, count))[:count]
    y = simulate(PLANT, u[:, None])[:, 0] + 1e-3 * rng.standard_normal(count)
    return [f"{t:.2f},{a:.6f},{b:.6f}" for t, a, b in zip(PERIOD * np.arange(count), u, y, strict=True)]


def write(path, lines, end="\n"):
    path.write_text("\n".join(["time_s,u,y", *lines]) + end)
    return path


def holed(path):
    """A log of 560 lines: one value missing, one line twice, ten lines between two gaps, the last line cut."""
    whole = rows()
    lines = [
        *whole[:300],
        f"{whole[300].rsplit(',', 1)[0]},",
        *whole[301:400],
        whole[399],
        *whole[430:440],
        *whole[451:],
    ]
    return write(path, [*lines[:-1], lines[-1][:-3]], end="")


def test_every_line_of_the_logs_is_used_or_counted_with_its_reason(tmp_path):
    fitted, held_back = holed(tmp_path / "log.csv"), write(tmp_path / "other.csv", rows(seed=1))
    logs = read_gimbal_logs([fitted], [held_back, write(tmp_path / "copy.csv", rows(seed=1))], READING)
    count = count_samples(logs.samples, logs.findings)
    assert count.held == 560 + 600
    assert count.left_out == {"truncated": 1, "missing-values": 1, "time-duplicate": 1, "short-piece": 10}
    assert count.used == sum(len(log.recording) for log in [*logs.training, *logs.validation]) == 1147
    (gap,) = [each for each in logs.findings if each.code == "gap"]
    assert "2 gaps of up to 0.31 s, where the sampling period is 0.01 s: about 41 samples not logged" in gap.message
    assert used_sentence(count) == (
        "1147 of 1160 samples used; left out: 1 in a last line that breaks off, 1 in rows that lack a value, 1 that "
        "repeat the one before, 10 in pieces between gaps too short to use."
    )


def test_logs_that_were_used_whole_are_said_to_be(tmp_path):
    logs = read_gimbal_logs([write(tmp_path / "log.csv", rows())], [], READING)
    assert used_sentence(count_samples(logs.samples, logs.findings)) == "All 600 samples used."


def test_a_rigid_axis_says_how_many_samples_it_left_out(command, tmp_path):
    rng, time = np.random.default_rng(0), 0.02 * np.arange(500)
    torque = 0.3 * np.sin(2 * np.pi * (0.3 * time + 0.13 * time**2))
    angle = np.cumsum(np.cumsum(torque)) * 0.02 + 1e-4 * rng.standard_normal(500)
    lines = [f"{t:.2f},{a:.6f},{b:.6f}" for t, a, b in zip(time, torque, angle, strict=True)]
    path = tmp_path / "torque.csv"
    path.write_text("\n".join(["time_s,torque,angle", *lines[:300], *lines[303:], "10.00,0.1"]) + "\n")
    status, out, _ = command("identify", "rigid", path, "--friction", "none", "--out", "out", "--json", "facts.json")
    assert status == 0
    assert "497 of 498 samples used; left out: 1 in a last line that breaks off." in " ".join(out.split())
    facts = json.loads((tmp_path / "facts.json").read_text())
    assert facts["samples"] == {"held": 498, "used": 497, "left_out": {"truncated": 1}}
