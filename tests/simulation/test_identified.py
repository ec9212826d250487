from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import map_arrays, single_precision
from archerfish.dynamics.command_limits import CommandLimits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.paper.conditions import assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.records.errors import InputError
from archerfish.records.muzzle import MuzzleRecord
from archerfish.records.plant import PlantRecord
from archerfish.records.sensing import CameraRecord, LinkRecord, SensingRecord
from archerfish.sensing.interfaces import Engagement, World, fire_always
from archerfish.simulation.identified import DRAWS, IdentifiedWorld
from archerfish.simulation.setting import make_world, muzzle_draws, paper_muzzle
from archerfish.targets.parabola import Parabola
from archerfish.targets.still import Static

CONDITIONS = assumed_conditions()
PERIOD = CONDITIONS.control_period_s
CAMERA = CameraRecord(
    rate_hz=80.0,
    time_offset=-0.134,
    stamp_jitter=0.0,
    bearing_sd=0.0,
    elevation_sd=0.0,
    range_sd=0.0,
    noise_range=3.0,
    miss_probability=0.0,
    outlier_share=0.0,
    latency=0.035,
    latency_jitter=0.0,
    latency_basis="exposure",
)
NOISY = replace(
    CAMERA, stamp_jitter=3e-4, bearing_sd=1e-3, elevation_sd=1e-3, range_sd=0.03, miss_probability=0.1,
    latency_jitter=0.002,
)  # fmt: skip
LINK = LinkRecord(feedback_rate_hz=1000.0)
# Both take no time; that of a frame and a feedback is a millionth of a second.
IMMEDIATE = SensingRecord(replace(CAMERA, rate_hz=1e6, latency=0.0), LinkRecord(feedback_rate_hz=1e6))
LATE = SensingRecord(NOISY, replace(LINK, command_latency=0.012, command_latency_jitter=0.003, feedback_latency=0.002))


def several(plant: PlantRecord, gains: tuple[float, ...]) -> PlantRecord:
    """Draw i answers a command gains[i] times as strongly."""
    draws = {name: np.repeat(getattr(plant, name)[None], len(gains), axis=0) for name in "ABCD"}
    return replace(plant, draws=draws | {"B": draws["B"] * np.array(gains)[:, None, None]})


def build(
    sensing: SensingRecord = LATE, limit: str = "box", gains: tuple[float, ...] = (), muzzle: MuzzleRecord | None = None
) -> IdentifiedWorld:
    plants = {axis: several(plant, gains) if gains else plant for axis, plant in printed_plants().items()}
    muzzle = paper_muzzle(CONDITIONS) if muzzle is None else muzzle
    world = make_world(plants["pitch"], plants["yaw"], muzzle, gate_limits(), limit, CONDITIONS, sensing=sensing)
    assert isinstance(world, IdentifiedWorld)
    return world


def engagements(shape: tuple[int, ...], plants: int = 1, seed: int = 201) -> Engagement:
    rng = np.random.default_rng(seed)
    motion = Parabola(
        rng.uniform([2.0, -0.7, 0.0], [5.0, 0.7, 0.1], (*shape, 3)),
        rng.uniform(0.1, 0.35, shape),
        rng.uniform(0.0, 1.0, shape),
        *(np.full(shape, each) for each in (0.115, 3.0)),
    )
    plant = np.asarray(rng.integers(0, plants, shape, dtype=np.int32))
    met: Engagement = single_precision(Engagement(motion, rng.uniform(-0.1, 0.1, (*shape, 2)), plant))
    return met


def normals(*shape: int, seed: int = 202) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((*shape, DRAWS)).astype(np.float32)


def fought(world: World, met: Engagement, draws: np.ndarray) -> tuple[list[Any], list[Any]]:
    """Follow the line of sight; all that is seen, and all shots."""
    state, seen = world.reset(met, draws)
    sights, shots = [seen], []
    for _ in range(draws.shape[-2]):
        state, seen, shot = world.step(state, fire_always(line_of_sight(seen.plate[..., 0, :])))
        sights.append(seen)
        shots.append(shot)
    return sights, shots


def test_the_world_keeps_the_protocol() -> None:
    world = build(gains=(1.0, 1.1, 0.9))
    assert isinstance(world, World)
    assert world.pure
    assert (world.plants, world.normals) == (3, DRAWS)
    assert world.period_s == pytest.approx(PERIOD)


def test_a_world_is_float32_throughout_in_what_it_is_and_gives() -> None:
    world, found = build(gains=(1.0, 1.1)), []
    map_arrays(found.append, world)
    assert {each.dtype for each in found if each.dtype.kind == "f"} == {np.dtype(np.float32)}
    state, seen = world.reset(engagements((3,)), normals(3, 2))
    _, seen, shot = world.step(state, fire_always(seen.angle))
    assert {each.dtype for each in (*seen, *shot) if each.dtype.kind == "f"} == {np.dtype(np.float32)}


def test_without_latency_and_noise_it_is_the_papers_world() -> None:
    met, draws = engagements((20,)), normals(20, 40)
    plants, muzzle = printed_plants(), paper_muzzle(CONDITIONS)
    for limit in ("box", "gate"):
        plain = make_world(plants["pitch"], plants["yaw"], muzzle, gate_limits(), limit, CONDITIONS, (0.0, 0.0))
        # The dispersion draws come first in both.
        (sights, shots), (seen, fired) = (
            fought(plain, met, np.concatenate([draws[..., :3], 0.0 * draws[..., :3]], axis=-1)),
            fought(build(IMMEDIATE, limit), met, draws),
        )
        for ours, theirs in zip(shots, fired, strict=True):
            assert_allclose(theirs.angle, ours.angle, atol=1e-5)
            assert_allclose(theirs.miss, ours.miss, atol=1e-4)
        for ours, theirs in zip(sights, seen, strict=True):
            assert_allclose(theirs.command, ours.command, atol=1e-5)
            assert_allclose(theirs.plate, ours.plate, atol=1e-5)
            assert_allclose(theirs.angle, ours.angle, atol=1e-5)
            assert_allclose(theirs.plate_age, 0.0, atol=3e-6)
            assert_allclose(theirs.elapsed, ours.elapsed)
            assert theirs.fresh.all()


def test_commands_come_late_by_the_latency() -> None:
    late = SensingRecord(CAMERA, replace(LINK, command_latency=0.015))
    met = Engagement(Static(np.array([[4.0, 0.0, 0.0]], "f4")), np.zeros((1, 2), "f4"), np.zeros(1, np.int32))
    plants = printed_plants()
    delayed = {axis: replace(plant, delay_samples=plant.delay_samples + 15) for axis, plant in plants.items()}
    answers = []
    for world in (
        build(late),
        make_world(**delayed, muzzle=paper_muzzle(CONDITIONS), limits=gate_limits(), command_limit="box",
                   conditions=CONDITIONS),
    ):  # fmt: skip
        state, _ = world.reset(met, np.zeros((1, 12, world.normals), np.float32))
        angles = []
        for step in range(12):
            state, _, shot = world.step(state, fire_always(np.full((1, 2), 0.05 * (step % 3), np.float32)))
            angles.append(shot.angle)
        answers.append(np.array(angles))
    assert np.abs(answers[0]).max() > 0.02
    assert_allclose(*answers, atol=1e-5)


def test_the_model_for_controllers_has_the_mean_latency() -> None:
    plants = printed_plants()
    expected = gimbal_model(plants["pitch"], plants["yaw"], PERIOD, 0.012)
    for found, wanted in zip(build().model, expected, strict=True):
        assert_allclose(found, wanted, rtol=1e-6, atol=1e-7)


def test_feedback_shows_the_gimbal_as_it_was() -> None:
    # 3…4 ms before each decision: compared with the same gimbal fought millisecond by millisecond.
    old = SensingRecord(CAMERA, replace(LINK, feedback_latency=0.0035))
    world, draws = build(old), 0.0 * normals(1, 10)
    met = Engagement(Static(np.array([[4.0, 0.0, 0.0]], "f4")), np.zeros((1, 2), "f4"), np.zeros(1, np.int32))
    state, seen = world.reset(met, draws)
    plants, angles = printed_plants(), []
    commands = [0.1 * ((step // 2) % 2) for step in range(10)]
    for command in commands:
        state, seen, _ = world.step(state, fire_always(np.full((1, 2), command, np.float32)))
        assert 0.0035 - 1e-6 <= seen.gimbal_age[0] <= 0.0045 + 1e-6
        angles.append((seen.angle[0], seen.gimbal_age[0]))
    for axis, plant in enumerate(plants.values()):
        ticks, x = [], np.zeros(len(plant.A))
        held = np.repeat(commands, 20)
        for tick in range(200):
            u = held[tick - plant.delay_samples] if tick >= plant.delay_samples else 0.0
            ticks.append((plant.C @ x + plant.D[:, 0] * u).item())
            x = plant.A @ x + plant.B[:, 0] * u
        for step, (angle, age) in enumerate(angles[:-1], 1):
            assert angle[axis] == pytest.approx(ticks[20 * step - round(age * 1000)], abs=1e-5)


def test_an_old_feedback_reaches_back_into_the_period_before() -> None:
    world = build(SensingRecord(CAMERA, replace(LINK, feedback_latency=0.030)))
    met, draws = engagements((5,)), 0.0 * normals(5, 8)
    fresh = build(SensingRecord(CAMERA, LINK))
    # At a decision the old one shows what the fresh one showed a period and a half before: the angle lies between its
    # neighbours on a way without overshoot.
    command = fire_always(np.full((5, 2), 0.2, np.float32))
    shown = {}
    for name, each in (("old", world), ("new", fresh)):
        state, seen = each.reset(met._replace(start=0.0 * met.start), draws)
        angles = [seen.angle]
        for _ in range(4):
            state, seen, _ = each.step(state, command)
            angles.append(seen.angle)
        shown[name] = np.array(angles)[..., 1]
    for step in (3, 4):
        assert np.all(shown["old"][step] > shown["new"][step - 2])
        assert np.all(shown["old"][step] < shown["new"][step - 1])


def test_feedback_of_several_periods_ago_shows_the_gimbal_as_it_was_then() -> None:
    # Whole periods and the same tick later: what the fresh feedback showed three decisions before.
    met, draws = engagements((5,)), 0.0 * normals(5, 12)
    wishes = np.random.default_rng(7).uniform(-0.1, 0.1, (12, 5, 2)).astype(np.float32)
    shown = []
    for latency in (0.0035, 0.0035 + 3 * PERIOD):
        world = build(SensingRecord(CAMERA, replace(LINK, feedback_latency=latency)))
        state, _ = world.reset(met._replace(start=0.0 * met.start), draws)
        angles = []
        for wish in wishes:
            state, seen, _ = world.step(state, fire_always(wish))
            angles.append(seen.angle)
        shown.append(np.array(angles))
    assert np.ptp(shown[0]) > 0.1
    assert_allclose(shown[1][3:], shown[0][:-3], atol=1e-6)
    assert_allclose(shown[1][:3], 0.0, atol=1e-6)


def test_feedback_that_is_of_no_use_is_refused() -> None:
    complaint = r"feedback is up to 0\.301 s old by the sensing record, expected at most 0\.25 s"
    with pytest.raises(InputError, match=complaint):
        build(SensingRecord(CAMERA, LinkRecord(feedback_rate_hz=1000.0, feedback_latency=0.3)))


def test_what_is_seen_of_a_moving_target_is_old() -> None:
    world = build(SensingRecord(CAMERA, LINK))
    met = engagements((30,))
    sights, _ = fought(world, met, normals(30, 20))
    for step, seen in enumerate(sights):
        now, age = np.float32(PERIOD * step), seen.plate_age[:, 0]
        assert np.all(age >= 0.035 - 1e-5)
        assert np.all(age <= 0.035 + 0.0125 + 1e-5)
        assert_allclose(seen.plate[:, 0], met.motion.position(now - age), atol=1e-5)


def test_the_limits_apply_whatever_is_asked() -> None:
    world, limits = build(limit="gate"), gate_limits()
    wild = np.random.default_rng(203).uniform(-4.0, 4.0, (40, 10, 2)).astype(np.float32)
    met = engagements((10,))
    state, _ = world.reset(met._replace(start=0.0 * met.start), normals(10, 40))
    commands = [np.zeros((10, 2))] * 2
    for wish in wild:
        state, seen, shot = world.step(state, fire_always(wish))
        commands.append(seen.command)
        assert np.all((shot.angle >= world.angle_low) & (shot.angle <= world.angle_high))
    asked = np.array(commands, np.float64)
    for axis, limit in enumerate((limits.pitch, limits.yaw)):
        assert np.all((asked[..., axis] >= limit.low - 1e-6) & (asked[..., axis] <= limit.high + 1e-6))
        acceleration = np.diff(asked[..., axis], n=2, axis=0) / PERIOD**2
        assert np.abs(acceleration).max() <= limit.max_acceleration * 1.005
    assert isinstance(world.limits, CommandLimits)


def test_the_same_draws_give_the_same_engagement() -> None:
    world, met, draws = build(gains=(1.0, 1.1)), engagements((4,), plants=2), normals(4, 6)
    for one, other in zip(fought(world, met, draws), fought(world, met, draws), strict=True):
        for ours, theirs in zip(one, other, strict=True):
            for found, expected in zip(ours, theirs, strict=True):
                assert np.array_equal(found, expected, equal_nan=True)


def test_a_batch_is_its_members() -> None:
    world, met, draws = build(gains=(1.0, 1.1, 0.9)), engagements((3,), plants=3), normals(3, 6)
    together = fought(world, met, draws)[1][-1]
    for member in range(3):
        one = map_arrays(lambda each, member=member: each[member], met)
        alone = fought(world, one, draws[member])[1][-1]
        assert_allclose(alone.miss, together.miss[member], atol=1e-5)
        assert alone.miss.shape == (2,)


def test_an_engagement_chooses_its_plant_and_its_muzzle() -> None:
    record = replace(paper_muzzle(CONDITIONS), intervals={"yaw_offset": (-0.02, 0.02), "speed": (16.0, 20.0)})
    world = build(IMMEDIATE, gains=(1.0, 2.0, 3.0), muzzle=record)
    met = Engagement(Static(np.tile(np.array([4.0, 0.0, 0.0], "f4"), (3, 1))), np.zeros((3, 2), "f4"),
                     np.array([2, 0, 1], np.int32))  # fmt: skip
    state, _ = world.reset(met, np.zeros((3, 1, DRAWS), np.float32))
    _, _, shot = world.step(state, fire_always(np.full((3, 2), 0.02, np.float32)))
    # A plant of thrice the gain answers a step from zero thrice as strongly.
    assert_allclose(shot.angle[:, 1] / shot.angle[1, 1], [3.0, 1.0, 2.0], rtol=1e-4)
    # The lateral miss of a shot from those angles with the draw's own offset.
    offset, drawn = world.muzzles.offset[met.plant, 1], world.muzzles.speed[met.plant]
    assert_allclose(shot.miss[:, 0], 4.0 * np.tan(shot.angle[:, 1] + offset), atol=1e-4)
    assert np.ptp(offset) > 1e-3
    # Without drag to speak of, flights last the longer the slower.
    flown = 4.0 / (np.cos(shot.angle[:, 1] + offset) * drawn)
    assert_allclose(shot.flight_time, flown, rtol=0.06)
    assert np.array_equal(np.argsort(shot.flight_time), np.argsort(flown))
    # Controllers are told the best estimate.
    assert world.see(state[0]).muzzle_speed == pytest.approx(record.speed)
    assert world.truth(met).muzzle.offset.tolist() == [0.0, 0.0]


def test_draws_of_a_muzzle_scatter_as_its_intervals_say() -> None:
    # Five standard errors of shares and of a standard deviation: a false alarm once in 500,000 seeds.
    count = 4000
    record = replace(
        paper_muzzle(CONDITIONS), intervals={"speed": (17.5, 18.5), "pitch_offset": (-0.01, 0.01), "drag": (0.0, 0.1)}
    )
    drawn = muzzle_draws(record, count)
    inside = np.mean(np.abs(drawn.speed - 18.0) <= 0.5)
    assert inside == pytest.approx(0.95, abs=5 * np.sqrt(0.95 * 0.05 / count))
    assert np.std(drawn.offset[:, 0]) == pytest.approx(0.01 / 1.96, rel=5 / np.sqrt(2 * count))
    assert drawn.drag.min() == 0.0  # never negative, unlike an offset
    assert drawn.offset[:, 0].min() < 0.0
    assert np.all(drawn.speed_sd == record.speed_sd)
    assert drawn.sd.shape == drawn.offset.shape == (count, 2)


def test_one_muzzle_is_the_best_estimate() -> None:
    record = replace(paper_muzzle(CONDITIONS), intervals={"speed": (17.5, 18.5)}, yaw_offset=0.01)
    drawn = muzzle_draws(record, 1)
    assert drawn.speed.tolist() == [record.speed]
    assert drawn.offset.tolist() == [[0.0, 0.01]]


def test_the_queue_holds_the_commands_of_the_latest_draw() -> None:
    # Nobody knows the latency to more than 60 ms here: some draws need places for more commands than the mean.
    record = SensingRecord(CAMERA, replace(LINK, command_latency=0.02), {"link.command_latency": (0.0, 0.12)})
    world = build(record, gains=(1.0,) * 40)
    slowest = int(np.argmax(world.sensing.command_latency))
    latency = float(world.sensing.command_latency[slowest])
    assert latency > 0.06
    met = Engagement(Static(np.array([[4.0, 0.0, 0.0]], "f4")), np.zeros((1, 2), "f4"), np.full(1, slowest, np.int32))
    state, _ = world.reset(met, np.zeros((1, 10, DRAWS), np.float32))
    for step in range(10):
        state, _, shot = world.step(state, fire_always(np.full((1, 2), 0.1, np.float32)))
        if PERIOD * (step + 1) < latency - 0.001:
            assert_allclose(shot.angle, 0.0, atol=1e-7)
    assert np.all(shot.angle > 0.01)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_numpy_and_jax_agree(shape, agree_in_jax) -> None:
    world = build(limit="gate", gains=(1.0, 1.05))

    def fight(world, met, draws):
        sights, shots = fought(world, met, draws)
        return sights[-1], shots[-1]

    seen, shot = agree_in_jax(fight, world, engagements(shape, plants=2), normals(*shape, 1), rtol=1e-4, atol=1e-3)
    assert shot.miss.shape == (*shape, 2)
    assert seen.plate.shape == (*shape, 1, 3)
