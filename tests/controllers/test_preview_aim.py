import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicHermiteSpline

from archerfish.controllers.predictors import Hold
from archerfish.controllers.preview_aim import angle_then, make_preview_aim, observer_gain
from archerfish.controllers.roster import make_controller
from archerfish.dynamics.delayed_gimbal import angle_and_rate, delayed_gimbal, rest_under, run, send
from archerfish.dynamics.linear_axis import gimbal_angle
from archerfish.paper.gimbal import printed_plants
from archerfish.sensing.interfaces import Seen
from archerfish.targets.passing import Line

PERIOD = 0.02


def sight(plate, plate_age=0.0, angle=(0.0, 0.0), gimbal_age=0.0, command=(0.0, 0.0), elapsed=PERIOD) -> Seen:
    """What one robot sees."""
    zero = np.zeros(())
    return Seen(
        elapsed=zero + elapsed,
        angle=np.asarray(angle),
        rate=np.zeros(2),
        gimbal_age=zero + gimbal_age,
        command=np.asarray(command),
        plate=np.asarray(plate)[None],
        normal_yaw=zero[None],
        plate_age=zero[None] + plate_age,
        fresh=np.array([True]),
        base=np.zeros(4),
        muzzle_speed=zero + 18.0,
        heat_left=zero + 1e6,
    )


@pytest.mark.parametrize("axis", [0, 1])
def test_the_observer_forgets_a_wrong_state(bench, axis) -> None:
    model = bench("box").model
    gain = observer_gain(model, axis)
    loop = (np.eye(len(gain)) - np.outer(gain, model.angle[axis])) @ model.transition[axis]
    assert np.max(np.abs(np.linalg.eigvals(loop))) < 1.0


def test_the_observer_gain_is_stationary(bench) -> None:
    # The Riccati recursion, iterated to its end.
    model = bench("box").model
    transition, row = model.transition[1], model.angle[1]
    process = np.deg2rad(0.1) ** 2 * np.outer(model.input[1], model.input[1]) + 1e-12 * np.eye(len(row))
    noise, covariance = np.deg2rad(0.01) ** 2, np.eye(len(row))
    for _ in range(2000):
        gain = covariance @ row / (row @ covariance @ row + noise)
        covariance = transition @ (covariance - np.outer(gain, row @ covariance)) @ transition.T + process
    assert_allclose(observer_gain(model, 1), gain, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("limit", ["box", "gate"])
def test_it_brings_the_gimbal_onto_a_static_target(bench, fight, limit) -> None:
    duel = fight(make_controller("kalman-lq", bench(limit)), limit, static_share=1.0)
    assert np.all(np.linalg.norm(duel.miss[30:], axis=-1) < 0.005)


def test_it_slews_faster_than_commanding_the_aim(bench, fight) -> None:
    misses = {
        name: np.linalg.norm(fight(make_controller(name, bench("box")), "box").miss, axis=-1)
        for name in ("kalman", "kalman-lq")
    }
    hits = {name: np.sum(miss <= 0.06) for name, miss in misses.items()}
    assert hits["kalman-lq"] > hits["kalman"] + 6 * 3  # three shots an engagement


def test_knowing_the_path_meets_a_moving_target_through_its_turns(bench, fight) -> None:
    duel = fight(make_controller("parabola-lq", bench("box")), "box", static_share=0.0)
    assert np.all(np.linalg.norm(duel.miss[25:], axis=-1) < 0.01)


def test_waiting_at_the_vertex_points_at_the_vertex(bench, fight) -> None:
    duel = fight(make_controller("vertex", bench("box")), "box", static_share=0.0)
    vertex = duel.truth.motion.vertex
    assert_allclose(duel.angle[-1, :, 1], np.arctan2(vertex[:, 1], vertex[:, 0]), atol=2e-3)


def test_an_imperfect_plant_leaves_no_error_at_rest_that_feedback_could_mend(bench, fight) -> None:
    # The observer believes feedback: a plant 5 % too weak still ends near the target.
    work = bench("box")
    weak = work.model._replace(input=0.95 * work.model.input, rest=0.95 * work.model.rest)
    controller = make_preview_aim(Hold(), work.muzzle, weak, work.limits, PERIOD)
    duel = fight(controller, "box", static_share=1.0)
    assert np.all(np.linalg.norm(duel.miss[40:], axis=-1) < 0.06)


@pytest.mark.parametrize("name", ["kalman", "kalman-lq"])
def test_an_old_sight_of_a_moving_target_is_carried_to_now(bench, name) -> None:
    line = Line(np.array([3.0, -0.5, 0.1]), np.array([-0.1, 0.6, 0.0]))
    commands = []
    for age in (0.0, 0.05):
        controller = make_controller(name, bench("box"))
        seen = [sight(line.position(np.asarray(PERIOD * step - age)), age) for step in range(30)]
        state = controller.reset(seen[0])
        for each in seen:
            state, command = controller.step(state, each)
        commands.append(command.angle)
    # Without its age it would be taken to be 10 mrad behind.
    assert_allclose(commands[1], commands[0], atol=1e-3)


@pytest.mark.parametrize("age", [0.003, 0.08])
def test_old_feedback_does_not_mislead_the_state_observer(bench, age) -> None:
    # The gimbal by the millisecond, its feedback milliseconds old: told so, the estimate is nearer the truth.
    plants, rng, draw = printed_plants(), np.random.default_rng(53), np.asarray(0)
    gimbal = delayed_gimbal(plants["pitch"], plants["yaw"], PERIOD)
    commands = np.cumsum(rng.uniform(-0.02, 0.02, (40, 2)), axis=0)
    errors = {}
    for told in (age, 0.0):
        controller = make_preview_aim(Hold(), bench("box").muzzle, bench("box").model, bench("box").limits, PERIOD)
        axes, off, shown = rest_under(gimbal, draw, np.zeros(2), 3), [], [np.zeros(2)] * 81
        state = controller.reset(sight((3.0, 0.0, 0.0)))
        for command in commands:
            axes = send(gimbal, draw, axes, command, np.asarray(0.0))
            for _ in range(20):
                axes = run(gimbal, draw, axes, np.asarray(1.0))
                shown.append(angle_and_rate(gimbal, draw, axes)[0])
            seen = sight((3.0, 0.0, 0.0), angle=shown[-1 - round(1e3 * age)], gimbal_age=told, command=command)
            state, _ = controller.step(state, seen)
            off.append(gimbal_angle(controller.model, state.plant) - angle_and_rate(gimbal, draw, axes)[0])
        errors[told] = np.sqrt(np.mean(np.square(off), axis=0))
    assert np.all(errors[age] < 0.5 * errors[0.0])


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_past_angles_are_those_of_scipys_hermite_spline_and_held_before_the_first(shape, agree_in_jax) -> None:
    rng = np.random.default_rng(54)
    past, age = rng.normal(0.0, 0.3, (*shape, 5, 2, 2)), rng.uniform(0.0, 0.12, shape)
    found = agree_in_jax(angle_then, past, age, np.asarray(PERIOD), atol=1e-6)
    for index in np.ndindex(shape):
        angle, rate = past[index][::-1, 0], past[index][::-1, 1]
        expected = CubicHermiteSpline(PERIOD * np.arange(-4, 1), angle, rate)(-min(age[index], 4 * PERIOD))
        assert_allclose(found[index], expected, atol=1e-6)
