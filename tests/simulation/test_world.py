import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.arrays import map_arrays, namespace
from archerfish.dynamics.aiming import line_of_sight
from archerfish.protocols import Engagement, aim
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.robot import Robot
from archerfish.simulation.camera import PLACE, STAMP, measured_place, sensing_from_record
from archerfish.simulation.world import make_world
from archerfish.targets.motion import Path, disc
from archerfish.task import Task

MUZZLE = Robot.paper().muzzle
QUIET = "time_offset stamp_jitter bearing_sd elevation_sd range_sd miss_probability outlier_share"
NOISE = {"stamp_jitter": 3e-4, "bearing_sd": 1e-3, "elevation_sd": 2e-3, "range_sd": 0.03, "miss_probability": 0.2}


def sensing(rate_hz=80.0, latency=0.035, feedback_rate_hz=1000.0, intervals=None, noise=None, **link):
    facts = dict.fromkeys(QUIET.split(), 0.0) | (noise or {}) | {"noise_range": 3.0, "latency_basis": "exposure"}
    link = LinkRecord(feedback_rate_hz=feedback_rate_hz, **link)
    camera = CameraRecord(rate_hz=rate_hz, latency=latency, **facts)
    return SensingRecord(camera=camera, link=link, intervals=intervals or {})


IMMEDIATE = sensing(1e6, 0.0, 1e6)
LATE = sensing(noise=NOISE, command_latency=0.012, command_latency_jitter=0.003, feedback_latency=0.002)


def world(limit="box", gains=(1.0,), delay=0, **parts):
    plants = {"pitch": Robot.paper().pitch, "yaw": Robot.paper().yaw}
    for axis, plant in plants.items():
        draws = {name: np.stack([getattr(plant, name)] * len(gains)) for name in "ABCD"}
        draws["B"] *= np.array(gains)[:, None, None]
        plants[axis] = plant.replace(draws=draws, delay_samples=delay)
    return make_world(Robot.paper().replace(**plants, **parts), Task(motion="paper", command_limit=limit))


def drawn(world, batch, decisions):
    """Return moving targets, normals of all decisions, and commands (T,) + B + (2,)."""
    rng, scenario = np.random.default_rng(1), Task(motion="dynamic").scenario(world.plants)
    engagement = scenario.draw(rng.random((*batch, scenario.uniforms), np.float32))
    normals = rng.standard_normal((*batch, decisions, world.normals), np.float32)
    return engagement, normals, rng.uniform(-0.1, 0.1, (decisions, *batch, 2)).astype(np.float32)


def run(world, engagement, normals, commands):
    """Return what is seen after each decision and the shots, decisions first."""
    state, found = world.begin(engagement, normals), []
    for place in range(len(commands)):
        state, shot = world.step(state, aim(commands[place]), normals[..., place, :])
        found.append((world.see(state), shot))
    return map_arrays(lambda *each: namespace(*each).stack(each), *found)


def test_a_shot_is_scored_where_it_crosses_the_plates_plane():
    # By hand, without drag: 20 m/s at 30° to the left is at y = 5 m after 0.5 s, and 1.226 m lower. The plate moves to
    # the left at 1 m/s and is at y = 4.4 m or further right when the pellet leaves, 0.1 s after the begin.
    exact, x = world(muzzle=MUZZLE.replace(speed=20.0, drag=0.0)), 10.0 * np.cos(np.pi / 6)
    ends = np.array([[x, 4.3, -1.2], [x, 5.3, -1.2]]) - [[[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.0]], [[0.0, 0.4, 0.0]]]
    target = disc(Path(ends, np.zeros(3), np.ones(3)), ends[:, 0])
    angle, fire = np.tile([0.0, np.pi / 6], (3, 1)), np.array([True, False, True])
    engagement = Engagement(target, 0.0 * angle, np.zeros(3, np.int32), np.ones(3))
    shot = exact.shoot(engagement, np.full(3, 0.1), angle, 0.0 * angle, fire, np.zeros((3, 6)))
    miss = np.array([[0.1, 1.2 - 9.81 / 8], [np.nan, np.nan], [0.5, 1.2 - 9.81 / 8]])
    assert_allclose(shot.miss, miss, atol=1e-5)
    assert_allclose(shot.margin, np.where(fire, 0.06 - np.hypot(*miss.T), -1e3), atol=1e-5)
    assert_allclose(shot.flight_time, [0.5, np.nan, 0.5], rtol=1e-5)
    assert shot.plate.tolist() == [0, -1, 0]


def test_a_pellet_that_flies_away_from_the_plate_crosses_nothing():
    wide = Robot.paper().limits.yaw.replace(low=-3.2, high=3.2)
    there = make_world(Robot.paper().replace(limits=Robot.paper().limits.replace(yaw=wide)), Task(motion="static"))
    engagement, normals, _ = drawn(there, (4,), 1)
    angle = np.array([[-0.04, np.pi], [0.0, np.pi / 2], [0.0, -np.pi / 2], [0.0, -3.1]], np.float32)
    shot = there.shoot(engagement, 0.0 * normals[:, 0, 0], angle, 0.0 * angle, angle[:, 0] < 1.0, 0.0 * normals[:, 0])
    assert (shot.margin.tolist(), shot.miss.tolist()) == ([-1e3] * 4, [[1e3, 1e3]] * 4)
    assert np.isnan(shot.flight_time).all()


@pytest.mark.parametrize("record", [None, IMMEDIATE])
def test_an_engagement_chooses_its_plant_and_its_muzzle(record):
    muzzle = MUZZLE.replace(intervals={"yaw_offset": (-0.02, 0.02)})
    there = world(gains=(1.0, 2.0, 3.0), muzzle=muzzle, sensing=record)
    engagement, normals, commands = drawn(there, (3,), 1)
    engagement = engagement._replace(plant=np.array([2, 0, 1], np.int32))
    angle = run(there, engagement, 0.0 * normals, 0.0 * commands + np.float32(0.02))[1].angle[0, :, 1]
    assert there.plants == 3
    assert_allclose(angle / angle[1], [3.0, 1.0, 2.0], rtol=1e-4)
    assert np.unique(there.muzzle_of(engagement).offset[..., 1]).size == (3 if record else 1)
    best = there.truth(engagement)
    assert not best.muzzle.offset.any()
    assert_allclose(best.gimbal.input, Robot.paper().gimbal(0.02).input, rtol=1e-6)


def test_what_no_controller_could_use_is_refused(refused):
    refused("frames are up to 2.01 s old .*, expected at most 0.3", world, sensing=sensing(latency=2.0))
    refused(r"feedback is up to 0\.301 s old .*, expected at most 0\.25", world, sensing=sensing(feedback_latency=0.3))
    refused("begins at a yaw of 3 rad, expected -1.31…1.31", make_world, Robot.paper(), Task(start=(0.0, 3.0)))


def test_without_latency_and_noise_camera_and_link_change_nothing():
    plain, linked = world("gate"), world("gate", sensing=IMMEDIATE)
    found = [run(each, *drawn(linked, (20,), 40)) for each in (plain, linked)]
    for ours, theirs in zip(*((*seen.frames, seen.gimbal.angle, shot.miss) for seen, shot in found), strict=True):
        assert_allclose(theirs, ours, atol=1e-4)


def test_frames_show_what_was_and_some_are_missed():
    there = world(sensing=sensing(noise={"miss_probability": 0.2}))
    engagement, normals, commands = drawn(there, (500,), 20)
    received, age, found, position, _ = run(there, engagement, normals, commands)[0].frames
    was = engagement.target.at(np.float32(0.02) * np.arange(1, 21, dtype=np.float32)[:, None] - age[..., 0]).position
    assert np.mean(received) == pytest.approx(0.8, abs=0.02)  # five standard errors
    assert np.all((age[received] > 0.0349) & (age[received] < 0.0476))
    assert_allclose(position[:, :, 0], np.where(received[..., None], was, 0.0), atol=1e-5)
    assert np.array_equal(found[..., 0], received)


NOISES = [(STAMP, 2.3e-3, 1.0), *((PLACE + k, 2e-3, 1.0 + 0.005 * k * (k - 1)) for k in range(3))]


@pytest.mark.parametrize(("which", "turned", "longer"), NOISES)
def test_noise_is_along_and_across_the_line_of_sight_and_late_moments_where_the_gimbal_turns(which, turned, longer):
    camera = sensing_from_record(LATE, 1)._replace(moment_error=np.full(1, 2e-3))
    place, rate = np.array([3.0, -2.0, 0.4]), np.array([0.5, 2.0])
    seen = measured_place(camera, np.asarray(0), place, rate, np.eye(11)[which])
    across = np.array([2e-3 * (which == PLACE), 1e-3 * (which == PLACE + 1)])
    assert_allclose(line_of_sight(seen) - line_of_sight(place), turned * rate + across, atol=2e-5)
    assert np.linalg.norm(seen) == pytest.approx(longer * np.linalg.norm(place), rel=1e-4)


@pytest.mark.parametrize("record", [None, LATE])
def test_numpy_and_jax_run_alike(batch, agree, record):
    there = world("gate", gains=(1.0, 1.05), sensing=record)
    agree(run, there, *drawn(there, batch, 2), rtol=1e-4, atol=1e-3)
