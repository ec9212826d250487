import itertools

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import kstest, norm

from archerfish.dynamics.aiming import line_of_sight
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.sensing.camera import (
    DRAWS,
    Sensing,
    feedback_age,
    first_sight,
    jittered,
    next_sight,
    phase,
    quantised,
    sensing_from_record,
    with_open_nearness,
)
from archerfish.targets.passing import Line
from archerfish.targets.still import Static

PERIOD = 0.02
PLACE = np.array([3.0, -2.0, 0.4])


def sensing(draws: int = 1, **changes) -> Sensing:
    """Eighty frames a second, 35 ms old, feedback of 1 kHz, and neither noise nor misses unless said."""
    facts = dict.fromkeys(Sensing._fields, 0.0)
    facts |= {"frame_period": 0.0125, "latency": 0.035, "feedback_period": 0.001, "miss": -np.inf, "noise_range": 4.0}
    facts |= changes
    across = np.broadcast_to(np.asarray(facts.pop("across")), (draws, 2))
    return Sensing(across=across, **{name: np.broadcast_to(np.asarray(each), (draws,)) for name, each in facts.items()})


def zeros(batch: int) -> np.ndarray:
    return np.zeros(batch, np.int32)


def watched(camera: Sensing, motion, normals: np.ndarray, phases: np.ndarray, rate=(0.0, 0.0)) -> list:
    """Times and sights at the decisions of B engagements, normals of shape (T, B, DRAWS)."""
    draw, batch = zeros(normals.shape[1]), normals.shape[1]
    sight = first_sight(camera, draw, phases, motion, 0.0 * phases, normals[0])
    moments = [(np.zeros(batch), sight)]
    for step, each in enumerate(normals[1:], 1):
        time, turning = np.full(batch, step * PERIOD), np.broadcast_to(np.asarray(rate), (batch, 2))
        sight = next_sight(camera, draw, phases, sight, time, motion, turning, 0.0 * time, each)
        moments.append((time, sight))
    return moments


def test_a_sight_is_as_old_as_the_latency_and_at_most_a_frame_more() -> None:
    rng = np.random.default_rng(61)
    phases = rng.random(50)
    normals = rng.standard_normal((40, 50, DRAWS))
    for time, sight in watched(sensing(), Static(np.tile(PLACE, (50, 1))), normals, phases):
        age = time - sight.exposed
        assert np.all(age >= 0.035 - 1e-12)
        assert np.all(age < 0.035 + 0.0125 + 1e-12)
        # The camera's frames come evenly, from a phase of their own.
        frames = sight.exposed / 0.0125 - phases
        assert_allclose(frames, np.round(frames), atol=1e-9)


def test_a_frame_counts_once_the_gimbal_has_reported_from_after_it() -> None:
    camera, batch = sensing(), 50
    phases, static = np.random.default_rng(69).random(batch), Static(np.tile(PLACE, (batch, 1)))
    normals, rest, reported = np.zeros((batch, DRAWS)), np.zeros((batch, 2)), np.full(batch, 0.08)
    sights = [first_sight(camera, zeros(batch), phases, static, reported, normals)]
    for time in (0.0, 0.02, 0.04):
        moment = np.full(batch, time)
        age = moment - sights[-1].exposed
        assert np.all(age >= 0.08 - 1e-12)
        assert np.all(age < 0.08 + 0.0125 + 1e-12)
        following = (moment + PERIOD, static, rest, reported, normals)
        sights.append(next_sight(camera, zeros(batch), phases, sights[-1], *following))


def test_with_jitter_an_exposure_never_goes_back_and_is_fresh_only_when_new() -> None:
    rng = np.random.default_rng(62)
    camera = sensing(latency_jitter=0.02, miss=norm.ppf(0.3))
    motion = Line(np.tile(PLACE, (200, 1)), np.tile([0.5, 0.3, 0.1], (200, 1)))
    moments = watched(camera, motion, rng.standard_normal((40, 200, DRAWS)), rng.random(200))
    stayed = 0
    for (_, before), (time, now) in itertools.pairwise(moments):
        assert np.all(now.exposed >= before.exposed)
        assert np.array_equal(now.fresh, now.exposed > before.exposed)
        assert np.array_equal(now.plate[~now.fresh], before.plate[~now.fresh])
        assert_allclose(now.plate, motion.position(now.exposed), atol=1e-12)
        assert np.all(time - now.exposed >= 0.0)
        stayed += np.sum(~now.fresh)
    assert 0.3 < stayed / (39 * 200) < 0.6


def test_a_slow_camera_shows_a_frame_at_several_decisions() -> None:
    moments = watched(sensing(frame_period=0.1), Static(PLACE[None]), np.zeros((26, 1, DRAWS)), np.array([0.3]))
    assert sum(bool(sight.fresh[0]) for _, sight in moments[1:]) == 5  # five frames in half a second


def test_what_noise_is_nearer_by_is_drawn_where_it_is_left_open() -> None:
    count = 20_000
    open_camera = with_open_nearness(sensing(3, across=0.001, noise_range=4.0))
    assert sorted(open_camera.nearness) == [0.0, 0.5, 1.0]
    normals = np.random.default_rng(64).standard_normal((count, DRAWS))
    static = Static(np.tile([2.0, 0.0, 0.0], (count, 1)))
    for draw, power in enumerate(open_camera.nearness):
        seen = first_sight(open_camera, zeros(count) + draw, np.zeros(count), static, np.zeros(count), normals).plate
        assert np.std(seen[:, 1]) == pytest.approx(2.0 * 0.001 * 2.0**power, rel=0.03)
    alone = sensing(1, across=0.001)
    assert with_open_nearness(alone).nearness == alone.nearness == 0.0


def test_noise_lies_along_and_across_the_line_of_sight() -> None:
    # Five standard errors: a false alarm once in about 600,000 seeds for the three.
    count, along_share, elevation, bearing = 20_000, 0.02, 0.003, 0.001
    camera = sensing(across=(elevation, bearing), along=along_share)
    normals = np.random.default_rng(63).standard_normal((count, DRAWS))
    static = Static(np.tile(PLACE, (count, 1)))
    error = first_sight(camera, zeros(count), np.zeros(count), static, np.zeros(count), normals).plate - PLACE
    distance = np.linalg.norm(PLACE)
    along = PLACE / distance
    left = np.array([2.0, 3.0, 0.0]) / np.sqrt(13.0)
    level = np.hypot(3.0, 2.0)
    for way, sd in (
        (along, along_share * distance),
        (left, bearing * level),
        (np.cross(along, left), elevation * distance),
    ):
        assert np.std(error @ way) == pytest.approx(sd, abs=5 * sd / np.sqrt(2 * count))
        # Means vanish; five standard errors again.
        assert np.mean(error @ way) == pytest.approx(0.0, abs=5 * sd / np.sqrt(count))


@pytest.mark.parametrize("rate", [(0.0, 2.0), (1.5, 0.0), (-1.0, 3.0)])
def test_an_error_of_the_moment_shows_as_an_angle_where_the_gimbal_turns(rate) -> None:
    camera = sensing(moment_error=0.003)
    _, sight = watched(camera, Static(PLACE[None]), np.zeros((2, 1, DRAWS)), np.zeros(1), rate)[1]
    assert_allclose(line_of_sight(sight.plate[0]) - line_of_sight(PLACE), 0.003 * np.array(rate), rtol=2e-2, atol=1e-5)
    assert np.linalg.norm(sight.plate[0]) == pytest.approx(np.linalg.norm(PLACE), rel=1e-4)


def test_stamp_jitter_shows_where_the_gimbal_turns_and_nowhere_else() -> None:
    # Five standard errors of a standard deviation: a false alarm once in about two million seeds.
    camera, count = sensing(moment_jitter=0.002), 5000
    normals = np.random.default_rng(64).standard_normal((2, count, DRAWS))
    static = Static(np.tile(PLACE, (count, 1)))
    _, turning = watched(camera, static, normals, np.zeros(count), (0.0, 2.0))[1]
    yaw = line_of_sight(turning.plate)[:, 1]
    assert np.std(yaw) == pytest.approx(0.004, rel=5 / np.sqrt(2 * count))
    _, resting = watched(camera, static, normals, np.zeros(count))[1]
    assert_allclose(resting.plate, static.place)


def test_misses_come_as_often_as_recorded_and_leave_the_last_sight() -> None:
    # Five standard errors: a false alarm once in about two million seeds.
    share, count, steps = 0.15, 500, 21
    rng = np.random.default_rng(65)
    camera = sensing(miss=norm.ppf(share))
    static = Static(np.tile(PLACE, (count, 1)))
    moments = watched(camera, static, rng.standard_normal((steps, count, DRAWS)), rng.random(count))
    # At 80 frames a second every period of 20 ms has a new one.
    missed = np.mean([~sight.fresh for _, sight in moments[1:]])
    assert missed == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / (count * (steps - 1))))
    ages = np.array([time - sight.exposed for time, sight in moments])
    lost = ~np.array([sight.fresh for _, sight in moments[1:]])
    assert_allclose((ages[1:] - ages[:-1])[lost], PERIOD)


def test_feedback_is_as_old_as_its_latency_and_at_most_a_period_more() -> None:
    rng = np.random.default_rng(66)
    link = sensing(feedback_period=0.008, feedback_latency=0.003, feedback_jitter=0.001)
    normals, phases = rng.standard_normal((1000, DRAWS)), rng.random(1000)
    age = feedback_age(link, zeros(1000), phases, np.full(1000, 0.26), normals)
    own = 0.003 + 0.001 * np.clip(normals[:, 7], -2, 2)
    assert np.all(age >= own - 1e-12)
    assert np.all(age < own + 0.008 + 1e-12)
    grid = (0.26 - age) / 0.008 - phases
    assert_allclose(grid, np.round(grid), atol=1e-9)


def test_jitter_is_cut_off_and_never_makes_a_latency_negative() -> None:
    normals = np.array([-9.0, -1.0, 0.0, 1.0, 9.0])
    assert_allclose(jittered(np.full(5, 0.01), np.full(5, 0.002), normals), [0.006, 0.008, 0.01, 0.012, 0.014])
    assert_allclose(jittered(np.full(2, 0.01), np.full(2, 0.02), normals[[0, 4]]), [0.0, 0.05])


def test_a_phase_is_uniform() -> None:
    # A right one is refused for one seed in a thousand.
    drawn = phase(np.random.default_rng(67).standard_normal(20_000))
    assert np.all((drawn >= 0) & (drawn < 1))
    assert kstest(drawn, "uniform").pvalue > 1e-3


def test_angles_are_rounded_to_the_step_of_their_draw_or_not_at_all() -> None:
    camera = sensing(draws=2, feedback_quantum=[0.0, 0.001])
    angle = np.array([[0.01234, -0.02371], [0.01234, -0.02371]])
    assert_allclose(quantised(camera, np.array([0, 1]), angle), [[0.01234, -0.02371], [0.012, -0.024]], atol=1e-15)


RECORD = SensingRecord(
    CameraRecord(
        rate_hz=80.0,
        time_offset=-0.134,
        stamp_jitter=3e-4,
        bearing_sd=0.0017,
        elevation_sd=0.0016,
        range_sd=0.045,
        noise_range=3.0,
        miss_probability=0.05,
        outlier_share=0.01,
        latency=0.035,
        latency_jitter=0.002,
        latency_basis="exposure",
    ),
    LinkRecord(feedback_rate_hz=500.0, feedback_quantum=7.7e-4, command_latency=0.008, command_latency_jitter=0.002),
    {
        "camera.rate_hz": (79.8, 80.2),
        "camera.time_offset": (-0.136, -0.132),
        "camera.latency": (0.034, 0.036),
        "camera.bearing_sd": (0.0015, 0.0019),
        "camera.range_sd": (0.03, 0.06),
        "link.command_latency": (0.0070, 0.0090),
        "link.command_latency_jitter": (0.0, 0.0300),
    },
)


def test_one_draw_is_the_best_estimate() -> None:
    found = sensing_from_record(RECORD)
    expected = sensing(
        latency_jitter=0.002,
        moment_jitter=3e-4,
        across=(0.0016, 0.0017),
        noise_range=RECORD.camera.noise_range,
        along=0.015,
        miss=norm.ppf(0.05),
        command_latency=0.008,
        command_jitter=0.002,
        feedback_period=0.002,
        feedback_quantum=7.7e-4,
    )
    for name in Sensing._fields:
        assert getattr(found, name).shape == getattr(expected, name).shape
        assert_allclose(getattr(found, name), getattr(expected, name), err_msg=name)


def test_draws_scatter_as_the_intervals_say() -> None:
    # Within 95 % intervals lie 95 % of the draws; five standard errors: a false alarm once in 300,000 seeds.
    count = 4000
    found = sensing_from_record(RECORD, count, seed=3)
    share = {
        "frame_period": (1 / 80.2, 1 / 79.8),
        "moment_error": (-0.002, 0.002),  # about no error: where the offset is, is known but for that
        "latency": (0.034, 0.036),
        "along": (0.01, 0.02),
        "command_latency": (0.007, 0.009),
    }
    for name, (low, high) in share.items():
        inside = np.mean((getattr(found, name) >= low) & (getattr(found, name) <= high))
        assert inside == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / count)), name
    assert np.all(found.across[:, 0] == 0.0016)  # no interval, no scatter
    assert np.std(found.across[:, 1]) == pytest.approx(0.0001 * 2 / 1.96, rel=5 / np.sqrt(2 * count))
    # A standard deviation and a latency are never negative, however wide their intervals.
    assert found.command_jitter.min() == 0.0
    assert np.all(found.latency >= 0)


def test_what_was_not_measured_is_zero() -> None:
    found = sensing_from_record(SensingRecord(RECORD.camera, LinkRecord(feedback_rate_hz=500.0)), 3)
    for name in ("command_latency", "command_jitter", "feedback_latency", "feedback_jitter", "feedback_quantum"):
        assert getattr(found, name).tolist() == [0.0] * 3


def test_the_same_seed_draws_the_same() -> None:
    one, same, other = (sensing_from_record(RECORD, 5, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.latency, same.latency)
    assert not np.array_equal(one.latency, other.latency)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(68)
    motion = Line(rng.uniform(1.0, 4.0, (*shape, 3)), rng.uniform(-1.0, 1.0, (*shape, 3)))
    draw = rng.integers(0, 3, shape, dtype=np.int32)

    def everything(sensing, draw, motion, time, rate, normals):
        phases = phase(normals[0][..., 0])
        first = first_sight(sensing, draw, phases, motion, 0.0 * phases, normals[0])
        age = feedback_age(sensing, draw, phases, time, normals[1])
        later = next_sight(sensing, draw, phases, first, time, motion, rate, age, normals[1])
        return first, later, age, quantised(sensing, draw, rate)

    camera = sensing_from_record(RECORD, 3)
    rate, normals = rng.uniform(-2.0, 2.0, (*shape, 2)), rng.standard_normal((2, *shape, DRAWS))
    _, later, age, _ = agree_in_jax(everything, camera, draw, motion, np.full(shape, 0.5), rate, normals, atol=1e-5)
    assert later.plate.shape == (*shape, 3)
    assert age.shape == shape
