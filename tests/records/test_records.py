import pickle
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from archerfish.dynamics.command_limits import limit_command
from archerfish.dynamics.linear_axis import gimbal_draws
from archerfish.records.json_files import plain, write_json
from archerfish.records.plant import PlantRecord
from archerfish.robot import RECORDS, PartVerdict, Robot
from archerfish.task import Task

FAULTS = [
    ("pitch", {"A": [["1"]]}, r"field A: expected float, got str"),
    ("pitch", {"D": [[1.0], [1.0, 2.0]]}, r"field D: .*inhomogeneous"),
    ("pitch", {"A": []}, r"expected 1…64 states, got 0"),
    ("pitch", {"A": [[1e13, 0.0], [0.0, 1.0]]}, r"field A: expected float <= 1000000000000.0"),
    ("pitch", {"draws": {"A": [[[1.0]]]}}, r"field draws\[A\]: expected shape \(1, 2, 2\), got \(1, 1, 1\)"),
    ("pitch", {"draw_delays": [7, 8]}, r"field draw_delays: expected shape \(3,\), got \(2,\)"),
    ("muzzle", {"speed": 0.0}, r"field speed: expected float >= 0.1, got 0.0"),
    ("muzzle", {"intervals": {"speed": [2.0, 1.0]}}, r"intervals.speed: expected low ≤ high, got 2 and 1"),
    ("limits", {"yaw": {"low": 1.0, "high": 0.5, "max_rate": 1.0, "max_acceleration": 1.0}}, r"low < high, got 1"),
    ("limits", {"yaw": {"low": None, "high": 0.5, "max_rate": 1.0, "max_acceleration": 1.0}}, r"or null for both"),
    (
        "limits",
        {"pitch": {"low": None, "high": None, "max_rate": 1.0, "max_acceleration": 1.0}},
        r"pitch: expected a",
    ),
    ("sensing", {"link": {"feedback_rate_hz": 9.0, "command_latency": -1e-3}}, r"link.command_latency: .* -0.001"),
]
AXIS_FAULTS = [
    ({"B": np.ones((1, 2)), "D": np.zeros((1, 2)), "input_names": ("a", "b")}, "yaw has 2 inputs"),
    ({"A": np.ones((1, 1))}, "yaw has a pole of magnitude 1, expected less .* or discretise a continuous model"),
    ({"C": -np.ones((1, 1))}, "yaw has a steady gain of -1, expected more than 0"),
    ({"delay_samples": 101}, "yaw has a delay of 1.01 s, expected 1 s or less"),
    ({"sample_period_s": 9e-6}, "yaw has a sampling period of 9e-06 s"),
]


@pytest.fixture(scope="module")
def robot():
    """A robot that has everything: draws with delays of their own, sensing, verdicts, something assumed."""
    found = Robot.load(Path(__file__).parents[1] / "infantry")
    for axis, plant in (("pitch", found.pitch), ("yaw", found.yaw)):
        draws = {name: matrices[:3] for name, matrices in plant.draws.items()}
        found = found.replace(**{axis: plant.replace(draws=draws, draw_delays=plant.draw_delays[:3])})
    parts = {"pitch": PartVerdict(usable=True, headline="fits"), "yaw": PartVerdict(usable=False, headline="drifts")}
    return found.replace(name="mine", assumed=("muzzle",), parts=parts)


@pytest.mark.parametrize("name", ["pitch", "muzzle", "sensing", "limits"])
def test_a_record_is_read_back_and_one_of_version_0_1_is_refused(tmp_path, robot, name, refused):
    record, path = getattr(robot, name), tmp_path / "x.json"
    record.save(path)
    for again in (type(record).load(path), pickle.loads(pickle.dumps(record))):
        assert plain(again) == plain(record)
    assert len(path.read_text().splitlines()) == len(record.__struct_fields__) + 3
    path.write_text(path.read_text().replace(record.schema, record.schema[:-1] + "1"))
    refused(r'x.json: field schema: expected "archerfish.\w*/\d", got .*/1.*; identify again', type(record).load, path)


def test_a_yaw_on_a_slip_ring_has_no_range(tmp_path, robot):
    limits = robot.limits.replace(yaw=robot.limits.yaw.replace(low=None, high=None))
    limits.save(tmp_path / "limits.json")
    assert '"yaw": {"low": null, "high": null' in (tmp_path / "limits.json").read_text()
    assert plain(type(limits).load(tmp_path / "limits.json")) == plain(limits)
    turned = robot.replace(limits=limits).command_limits(Task.load("any"))
    command = np.array([0.0, 500.0])  # 80 turns
    wanted = np.array([0.01, 500.01])
    reached = limit_command(turned, wanted, command, (wanted - command) / 0.02, 0.0 * command, 0.02)
    assert_allclose(reached, wanted)


@pytest.mark.parametrize(("name", "change", "complaint"), FAULTS)
def test_a_bad_field_is_named(tmp_path, robot, name, change, complaint, refused):
    record, path = getattr(robot, name), tmp_path / "x.json"
    write_json(path, {"schema": record.schema, **plain(record), **change})
    refused(f"^{path}: .*{complaint}.*; identify again$", type(record).load, path)
    refused(complaint, record.replace, **change)


def test_a_latency_has_a_basis(robot, refused):
    refused(r'latency_basis: .* got ""', robot.sensing.camera.replace, latency_basis="")


def test_numbers_of_numpy_are_numbers_and_those_that_are_not_finite_are_refused(robot, refused):
    assert robot.limits.yaw.replace(low=np.float32(-1.0), high=np.int64(1)).high == 1.0
    assert type(robot.muzzle.replace(speed=18).speed) is float
    for value in (float("nan"), float("inf")):
        refused("field D: expected float", robot.pitch.replace, D=np.array([[value]]))
        refused("field speed_sd: expected float", robot.muzzle.replace, speed_sd=value)


@pytest.mark.parametrize("damping", [0.4, 3.0])
def test_a_second_order_plant_steps_as_in_continuous_time(damping):
    plant, w = PlantRecord.second_order(9.8, damping, delay_s=5e-3, gain=1.1), 2 * np.pi * 9.8
    expected = signal.step(([w**2], [1, 2 * damping * w, w**2]), T=1e-3 * np.arange(300))[1]
    for gain, scaled in ((1.1, plant), (0.9, plant.with_dc_gain(0.9))):
        found = signal.dlsim(scaled.to_state_space(), np.ones(305))[1]
        assert_allclose(found[5:, 0], gain * expected, atol=1e-12)


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_the_matrices_that_are_given_out_contain_the_delay(delay):
    rng = np.random.default_rng(0)
    matrices, u = [rng.uniform(-0.3, 0.3, each) for each in ((3, 3), (3, 2), (2, 3), (2, 2))], rng.normal(size=(50, 2))
    plant = PlantRecord.from_state_space(*matrices, 0.01, delay_samples=delay)
    late = np.vstack([np.zeros((delay, 2)), u])[:50]
    assert_allclose(signal.dlsim(plant.to_state_space(), u)[1], signal.dlsim((*matrices, 0.01), late)[1], atol=1e-12)


def test_a_system_is_a_plant_if_it_is_in_discrete_time(refused):
    lag = signal.StateSpace([[-2.0]], [[2.0]], [[1.0]], [[0.0]])
    plant = PlantRecord.from_state_space(lag.to_discrete(0.01), delay_samples=3)
    assert (plant.A.item(), plant.sample_period_s, plant.delay_samples) == (pytest.approx(np.exp(-0.02)), 0.01, 3)
    refused(r"a period dt above 0 s.*got dt None; discretise .*c2d.*cont2discrete", PlantRecord.from_state_space, lag)
    refused("got dt 0;", PlantRecord.from_state_space, lag.A, lag.B, lag.C, lag.D, 0)


def test_what_no_plant_can_be_made_of_is_refused(robot, refused):
    refused("json:dumps: gives a str for yaw, expected a PlantRecord", robot.replace, yaw="json:dumps")
    refused(r"delay_s must be a multiple .* got 0.0123", PlantRecord.second_order, 9.8, 0.4, delay_s=0.0123)
    refused("natural_hz must be > 0", PlantRecord.second_order, -1.0, 0.4)
    integrator = PlantRecord.from_state_space(1.0, 1.0, 1.0, 0.0, 0.01, delay_samples=3000)
    refused("integrates", integrator.with_dc_gain, 1.0)
    refused("expected matrices .*, or what has them as control.ss", PlantRecord.from_state_space, {})
    refused("delay of 3000 samples has 3001 states", integrator.to_state_space)


def test_beside_a_plant_of_one_s_own_the_rest_of_the_paper_s_robot_is_assumed():
    assert Robot.paper().replace(yaw=Robot.paper().yaw).assumed == ("pitch", "muzzle", "limits")
    other = Robot.paper().replace(limits=Robot.paper().limits, muzzle=Robot.paper().muzzle)
    assert (other.assumed, other.name) == ((), "paper, other limits and muzzle")


def test_a_robot_of_two_plants_alone_assumes_muzzle_and_limits(tmp_path, robot, refused):
    found = Robot(pitch=robot.pitch, yaw=robot.yaw)
    assert (found.name, found.assumed) == ("robot", ("muzzle", "limits"))
    assert found.replace(muzzle=robot.muzzle).assumed == ("limits",)
    found.save(tmp_path / "mine")
    assert plain(Robot.load(tmp_path / "mine").replace(folder=None)) == plain(found)
    assert Robot(pitch=robot.pitch, yaw=robot.yaw, muzzle=robot.muzzle, limits=robot.limits).assumed == ()
    refused("Robot: field yaw is missing; give yaw", Robot, pitch=robot.pitch)
    refused("Robot: field yaw: expected a PlantRecord, got str", Robot, pitch=robot.pitch, yaw="yaw.json")
    refused("robot.json: is the name of a file, .*; save a robot into a folder", found.save, tmp_path / "robot.json")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_a_robot_is_read_back_and_what_is_replaced_is_no_longer_assumed_or_judged(tmp_path, robot, refused):
    robot.save(tmp_path)
    again = Robot.load(tmp_path, accept_unusable=True)
    assert (again.name, again.assumed, again.folder) == ("mine", ("muzzle",), tmp_path)
    assert again.digest() == robot.digest() != Robot.paper().digest()
    refused(r"yaw.json: is not usable: drifts; identify it again, or .*accept_unusable=True", Robot.load, tmp_path)
    new = again.replace(yaw=Robot.paper().yaw, muzzle=robot.muzzle.replace(speed=20.0), sensing=None)
    assert (new.assumed, list(new.parts), new.folder) == ((), ["pitch"], None)
    new.save(tmp_path)
    assert Robot.load(tmp_path).record_digests() == new.record_digests()
    axes = "pitch: order 2, delay 1 ms, 3 draws; yaw: order 4, delay 0 ms"
    assert repr(Robot.load(tmp_path)) == repr(new) == f"Robot(mine; {axes}; muzzle: 20 m/s)"


def test_a_validation_residual_is_kept_and_leaves_the_digests_as_they_are(tmp_path, refused):
    # Stored records: those of the paper's robot are computed, with other last digits on other processors.
    stored = Robot.load(Path(__file__).parents[1] / "infantry")
    digest = "c19e2bf620d0b408c1d38468cf481caabc9e690927a4c3bd908460a8236af4fb"  # of records without the field
    none, judged = (stored.replace(yaw=stored.yaw.replace(validation_residual=each)) for each in (None, 2e-3))
    assert (none.yaw.validation_residual, none.digest(), judged.digest()) == (None, digest, digest)
    judged.yaw.save(tmp_path / "yaw.json")
    assert PlantRecord.load(tmp_path / "yaw.json").validation_residual == 2e-3
    refused("validation_residual: expected float >= 0", stored.yaw.replace, validation_residual=-1.0)


def test_a_folder_of_records_is_a_robot_whose_missing_parts_are_assumed(tmp_path, robot, refused):
    robot.save(tmp_path)
    for part in ("sensing", "limits"):
        (tmp_path / f"{part}.json").unlink()
        refused(f"expected a folder with {part}.json", Robot.load, tmp_path, accept_unusable=True)
        robot.replace(sensing=None).save(tmp_path)
    (tmp_path / "limits.json").unlink()
    (tmp_path / "robot.json").unlink()
    found = Robot.load(tmp_path)
    assert (found.name, found.assumed) == (tmp_path.name, ("sensing", "limits"))
    assert found.record_digests()["limits"] == Robot.paper().record_digests()["limits"]
    (tmp_path / "pitch.json").write_bytes((tmp_path / "yaw.json").read_bytes())
    refused(f"{tmp_path}: pitch is the plant of the yaw axis, .*; swap the two, or", Robot.load, tmp_path)


@pytest.mark.parametrize(("change", "complaint"), AXIS_FAULTS)
def test_what_can_not_be_the_axis_of_a_gimbal_is_refused(robot, change, complaint, refused):
    plant = PlantRecord.from_state_space(0.5, 0.5, 1.0, 0.0, 0.01)
    assert robot.replace(yaw=plant).yaw is plant
    refused(complaint, lambda: robot.replace(yaw=plant.replace(**change)))


@pytest.mark.parametrize("name", [*RECORDS, "robot"])
def test_a_mutated_file_is_refused_or_is_of_a_robot_that_works(tmp_path, robot, mutated, name):
    robot.save(tmp_path)
    for found in mutated(tmp_path / f"{name}.json", lambda: Robot.load(tmp_path, accept_unusable=True), 27):
        found.save(tmp_path / "copy")
        assert Robot.load(tmp_path / "copy", accept_unusable=True).digest() == found.digest()
        models = (found.gimbal(0.02), gimbal_draws(found.pitch, found.yaw, 0.02))
        assert all(np.all(np.isfinite(each)) for model in models for each in model)
