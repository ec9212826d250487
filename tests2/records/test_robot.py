import numpy as np
import pytest

from archerfish2.dynamics.linear_axis import gimbal_draws
from archerfish2.paper.gimbal import printed_plants
from archerfish2.records.plant import PlantRecord
from archerfish2.robot import RECORDS, Robot

CODE = """from archerfish2.records.plant import PlantRecord
fast, none = PlantRecord.second_order(9.0, 0.5), None
def slow(axis): return PlantRecord.second_order(7.0, 0.5)"""
FAULTS = [
    ({"B": np.ones((1, 2)), "D": np.zeros((1, 2)), "input_names": ("a", "b")}, "yaw has 2 inputs"),
    ({"A": np.ones((1, 1))}, "yaw has a pole of magnitude 1, expected less"),
    ({"C": -np.ones((1, 1))}, "yaw has a steady gain of -1, expected more than 0"),
    ({"delay_samples": 101}, "yaw has a delay of 1.01 s, expected 1 s or less"),
    ({"sample_period_s": 9e-6}, "yaw has a sampling period of 9e-06 s"),
]


def test_a_robot_is_read_back_and_what_is_replaced_is_no_longer_assumed_or_judged(tmp_path, robot, refused):
    robot.save(tmp_path)
    again = Robot.load(tmp_path, accept_unusable=True)
    assert (again.name, again.assumed, again.folder) == ("mine", ("muzzle",), tmp_path)
    assert again.digest() == robot.digest() != Robot.paper().digest()
    refused(r"yaw.json: is not usable: drifts; identify it again, or .*--accept-unusable", Robot.load, tmp_path)
    new = again.replace(yaw=printed_plants()["yaw"], muzzle=robot.muzzle.replace(speed=20.0), sensing=None)
    assert (new.assumed, list(new.parts), new.folder) == ((), ["pitch"], None)
    new.save(tmp_path)
    assert Robot.load(tmp_path).record_digests() == new.record_digests()
    axes = "pitch: order 2, delay 1 ms, 3 draws; yaw: order 4, delay 0 ms"
    assert repr(Robot.load(tmp_path)) == repr(new) == f"Robot(mine; {axes}; muzzle: 20 m/s)"


def test_a_folder_of_records_is_a_robot_whose_missing_parts_are_assumed(tmp_path, robot, refused):
    robot.save(tmp_path)
    (tmp_path / "limits.json").unlink()
    refused("expected a folder with limits.json", Robot.load, tmp_path, accept_unusable=True)
    (tmp_path / "robot.json").unlink()
    found = Robot.load(tmp_path)
    assert (found.name, found.assumed) == (tmp_path.name, ("limits",))
    assert found.record_digests()["limits"] == Robot.paper().record_digests()["limits"]
    (tmp_path / "pitch.json").write_bytes((tmp_path / "yaw.json").read_bytes())
    refused(f"{tmp_path}: pitch is the plant of the yaw axis, .*; swap the two", Robot.load, tmp_path)


@pytest.mark.parametrize(("change", "complaint"), FAULTS)
def test_what_can_not_be_the_axis_of_a_gimbal_is_refused(robot, change, complaint, refused):
    plant = PlantRecord.from_state_space(0.5, 0.5, 1.0, 0.0, 0.01)
    assert robot.replace(yaw=plant).yaw is plant
    refused(complaint, lambda: robot.replace(yaw=plant.replace(**change)))


def test_a_plant_may_be_a_user_s_code(tmp_path, robot, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(CODE)
    new = robot.replace(pitch="./mine.py:fast", yaw="mine:slow")
    assert [(each.axis, each.A[0, 0] < 0.9985) for each in (new.pitch, new.yaw)] == [("pitch", True), ("yaw", False)]
    refused("mine.py:none: gives a NoneType for yaw, expected a PlantRecord", robot.replace, yaw="mine:none")


@pytest.mark.parametrize("name", [*RECORDS, "robot"])
def test_a_mutated_file_is_refused_or_is_of_a_robot_that_works(tmp_path, robot, mutated, name):
    robot.save(tmp_path)
    for found in mutated(tmp_path / f"{name}.json", lambda: Robot.load(tmp_path, accept_unusable=True), 27):
        found.save(tmp_path / "copy")
        assert Robot.load(tmp_path / "copy", accept_unusable=True).digest() == found.digest()
        models = (found.gimbal(0.02), gimbal_draws(found.pitch, found.yaw, 0.02))
        assert all(np.all(np.isfinite(each)) for model in models for each in model)
