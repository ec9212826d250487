"""What stands between a controller and the robot on a real computer: a fallback, and the lines of deploy.toml."""

from typing import NamedTuple

import numpy as np
import pytest

from archerfish.errors import InputError
from archerfish.protocols import Command
from archerfish.runtime.configuration import DeployConfig, read_config
from archerfish.runtime.fallback import WithFallback


class Seen(NamedTuple):
    """What a controller sees: the command in force is enough here."""

    command: np.ndarray


SEEN = Seen(np.zeros((1, 2)))


class Aims:
    """Commands an angle; fails in its own way from its third decision on."""

    def __init__(self, angle, fails=None):
        self.angle, self.fails = angle, fails

    def reset(self, seen):
        return 0

    def step(self, count, seen):
        failing = count >= 2 and self.fails
        if failing == "raises":
            raise ZeroDivisionError("by a distance")
        angle = np.full((1, 2), np.nan if failing == "nan" else self.angle)
        return count + 1, Command(angle, np.zeros_like(angle), np.array([True]), np.ones(1))


FAULTS = {
    "raises": "ZeroDivisionError: by a distance",
    "nan": "its command is not finite, or absurd",
    "late": "it took 30.0 ms, 3 times in a row",
}


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_is_answered_in_the_same_decision_and_for_good(kind):
    steps = [0.001, 0.001, *(3 * [0.03] if kind == "late" else [0.001])]
    times = iter([time for at, step in enumerate(steps) for time in (at, at + step)])
    both = WithFallback(Aims(0.1, kind), Aims(0.2), 0.01, lambda: next(times))
    memory, angles = both.reset(SEEN), []
    for _ in range(7):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    own = len(steps) - 1
    assert (angles, both.fault) == (own * [0.1] + (7 - own) * [0.2], FAULTS[kind])


def test_the_operator_may_choose_the_fallback_and_go_back():
    both, angles = WithFallback(Aims(0.1), Aims(0.2), 1.0), []
    memory = both.reset(SEEN)
    for both.is_fallback_chosen in (False, True, False):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    assert (angles, both.fault) == ([0.1, 0.2, 0.1], "")


def test_a_controller_that_fails_at_once_is_replaced():
    class Broken(Aims):
        def reset(self, seen):
            raise KeyError("plate")

    both = WithFallback(Broken(0.1), Aims(0.2), 1.0)
    _, command = both.step(both.reset(SEEN), SEEN)
    assert (command.angle[0, 0], both.fault) == (0.2, "KeyError: 'plate'")


def test_where_both_fail_there_is_no_command():
    both = WithFallback(Aims(0.1, "raises"), Aims(0.2, "raises"), 1.0)
    memory, angles = both.reset(SEEN), []
    for _ in range(4):
        memory, command = both.step(memory, SEEN)
        angles.append(command.angle[0, 0])
    np.testing.assert_array_equal(angles, [0.1, 0.1, np.nan, np.nan])
    assert not command.fire.any()


def test_deploy_toml_has_defaults_and_refuses_what_it_does_not_know(tmp_path):
    usual = read_config(tmp_path)
    assert (usual.wires, usual.controller.fallback, usual.detections.latency_ms) == (("sp_vision_25",), "kalman", None)
    assert read_config(None).port == DeployConfig().port == ""
    file = tmp_path / "deploy.toml"
    file.write_text('wires = ["sp_vision_25", "referee"]\n[gate]\nshots_per_s = 8.0\n[detections]\nlatency_ms = 12\n')
    config = read_config(tmp_path)
    assert (config.wires, config.gate.shots_per_s, config.detections.latency_ms) == (("sp_vision_25", "referee"), 8, 12)
    wrong = {
        "watchdog_ms = 500": "unknown field watchdog_ms",
        "baud = 5": "field baud: ",
        "[gate]\nstale = 1.0": "gate",
        "[detections]\nlatency_ms = -1": "field detections.latency_ms: ",
        "port = ": "is not TOML",
    }
    for text, expected in wrong.items():
        file.write_text(text)
        with pytest.raises(InputError, match=r"deploy\.toml: .*" + expected.replace(".", r"\.")):
            read_config(tmp_path)
