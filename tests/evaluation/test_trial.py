from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest

from archerfish.controllers.roster import Workbench, make_controller
from archerfish.dynamics.aiming import line_of_sight
from archerfish.dynamics.array_namespace import namespace
from archerfish.dynamics.command_limits import named_limits
from archerfish.dynamics.linear_axis import gimbal_model
from archerfish.dynamics.muzzle import muzzle_from_record
from archerfish.evaluation.suites import Trials, draw_trials, table_suites
from archerfish.evaluation.trial import Shots, fight, largest_acceleration, perfect_shots
from archerfish.paper.conditions import Conditions, assumed_conditions
from archerfish.paper.gimbal import gate_limits, printed_plants
from archerfish.sensing.interfaces import Command, Engagement, Seen, Shot, Truth, fire_always
from archerfish.simulation.setting import make_world, paper_muzzle
from archerfish.simulation.shooting import ShootingWorld

CONDITIONS = assumed_conditions()
PERIOD = CONDITIONS.control_period_s


class BangBang(NamedTuple):
    """Asks for the far right and the far left in turns: all that the limits must hold back."""

    flip_every: Any
    """Decisions between two flips, shape ()."""

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        return 0.0 * seen.elapsed

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        xp = namespace(seen.angle)
        side = 1.0 - 2.0 * (xp.floor(state / self.flip_every) % 2.0)
        return state + 1.0, fire_always(10.0 * side[..., None] + 0.0 * seen.angle)


class Told(NamedTuple):
    """Aims at the vertex of the path, which it is told."""

    height: Any
    """Above the line of sight [rad], shape ()."""

    needs_truth = True

    def reset(self, seen: Seen, truth: Truth | None = None) -> Any:
        assert truth is not None
        return line_of_sight(truth.motion.vertex)

    def step(self, state: Any, seen: Seen) -> tuple[Any, Command]:
        return state, fire_always(state + self.height)


class Stepped:
    """The simulation as a world that can't be compiled, like a robot."""

    pure = False

    def __init__(self, world: ShootingWorld) -> None:
        self.world = world
        self.period_s = world.period_s

    def reset(self, engagements: Engagement, draws: Any) -> tuple[Any, Seen]:
        return self.world.reset(engagements, draws)

    def step(self, state: Any, command: Command) -> tuple[Any, Seen, Shot]:
        return self.world.step(state, command)

    def truth(self, engagements: Engagement) -> Truth:
        return self.world.truth(engagements)


def build_world(command_limit: str = "gate", conditions: Conditions = CONDITIONS) -> ShootingWorld:
    muzzle, limits = paper_muzzle(conditions), gate_limits()
    return make_world(
        **printed_plants(), muzzle=muzzle, limits=limits, command_limit=command_limit, conditions=conditions
    )


@pytest.fixture(scope="module")
def build_controller() -> Callable[[str, str], Any]:
    model = gimbal_model(**printed_plants(), period_s=PERIOD)
    muzzle = muzzle_from_record(paper_muzzle(CONDITIONS))

    def build(name: str, command_limit: str = "gate") -> Any:
        limits = named_limits(command_limit, gate_limits(), CONDITIONS.line_of_sight_lead)
        return make_controller(name, Workbench(model, muzzle, limits, CONDITIONS))

    return build


@pytest.fixture(scope="module")
def trials() -> Trials:
    return draw_trials(table_suites(CONDITIONS), engagements=6, decisions=CONDITIONS.decisions, seed=0)


def test_a_world_compiled_is_the_world_stepped(build_controller: Callable[..., Any], trials: Trials) -> None:
    world, controller = build_world(), build_controller("kalman")
    compiled, stepped = fight(world, controller, trials), fight(Stepped(world), controller, trials)
    for name in ("miss", "command", "angle"):
        assert getattr(compiled, name).shape == getattr(stepped, name).shape == (48, CONDITIONS.decisions, 2)
    assert np.all(compiled.fired & stepped.fired)
    assert compiled.fired.shape == stepped.fired.shape == (48, CONDITIONS.decisions)
    # Filters and limits amplify single rounding differences; a wrong step would be off by a hundred times that.
    np.testing.assert_allclose(compiled.angle, stepped.angle, atol=2e-5)
    np.testing.assert_allclose(compiled.miss, stepped.miss, atol=1e-4)


def stepped_in_numpy(world: Any, controller: Any, trials: Trials) -> Shots:
    """All of it in NumPy, as on a robot."""
    shooting, seen = world.reset(trials.engagements, trials.draws)
    truth = world.truth(trials.engagements) if getattr(controller, "needs_truth", False) else None
    state, shots = controller.reset(seen, truth), []
    for _ in range(trials.draws.shape[1]):
        state, command = controller.step(state, seen)
        shooting, seen, shot = world.step(shooting, command)
        shots.append((shot.fired, shot.miss, seen.command, shot.angle, command.fallback))
    return Shots(*(np.stack(each, axis=1) for each in zip(*shots, strict=True)))


@pytest.mark.parametrize("name", ["kalman", "oracle"])
def test_a_controller_that_decides_for_some_at_a_time_decides_as_for_all_at_once(
    build_controller: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    few = draw_trials(table_suites(CONDITIONS), engagements=2, decisions=8, seed=4)
    world, controller = Stepped(build_world()), build_controller(name)
    at_once = fight(world, controller, few)
    monkeypatch.setattr("archerfish.evaluation.trial._DECIDED_TOGETHER", range(3, 6))
    in_fours = fight(world, controller, few)
    np.testing.assert_array_equal(at_once.fired, in_fours.fired)
    np.testing.assert_allclose(at_once.command, in_fours.command, atol=1e-5)
    np.testing.assert_allclose(at_once.miss, in_fours.miss, atol=1e-4)


@pytest.mark.parametrize("name", ["kalman", "told"])
def test_a_controller_compiled_for_a_world_that_is_not_shoots_as_it_does_in_numpy(build_controller, name) -> None:
    few = draw_trials(table_suites(CONDITIONS), engagements=1, decisions=8, seed=4)
    world, controller = build_world(), Told(np.float32(0.01)) if name == "told" else build_controller(name)
    compiled, plain = fight(Stepped(world), controller, few), stepped_in_numpy(world, controller, few)
    np.testing.assert_allclose(compiled.command, plain.command, atol=2e-4)
    np.testing.assert_allclose(compiled.angle, plain.angle, atol=2e-4)
    np.testing.assert_allclose(compiled.miss, plain.miss, atol=2e-3)
    assert compiled.fired.dtype == bool
    assert {each.dtype for each in (compiled.miss, compiled.command, compiled.angle)} == {np.dtype(np.float32)}


@pytest.mark.parametrize("flip_every", [1.0, 7.0])
def test_under_gate_no_controller_asks_more_than_the_motors_give(trials: Trials, flip_every: float) -> None:
    limits = gate_limits()
    shots = fight(build_world("gate"), BangBang(np.float32(flip_every)), trials)
    for axis, limit in ((0, limits.pitch), (1, limits.yaw)):
        asked = largest_acceleration(shots.command, PERIOD, axis)
        assert 0.9 * limit.max_acceleration < asked <= 1.01 * limit.max_acceleration
        assert shots.command[..., axis].min() >= limit.low - 1e-6
        assert shots.command[..., axis].max() <= limit.high + 1e-6
    assert limits.yaw.max_acceleration <= 67.0


def test_under_box_a_controller_may_ask_for_more(trials: Trials) -> None:
    shots = fight(build_world("box"), BangBang(np.float32(1.0)), trials)
    assert largest_acceleration(shots.command, PERIOD, axis=1) > 1000.0


def test_perfect_aim_meets_the_armor_without_dispersion() -> None:
    exact = replace(CONDITIONS, dispersion=0.0, muzzle_speed_sd=0.0)
    shots = perfect_shots(build_world(conditions=exact), draw_trials(table_suites(exact), 200, 10, seed=0))
    assert np.abs(shots.miss).max() < 1e-3
    assert np.all(shots.hits(exact.hit_radius))


def test_perfect_aim_hits_as_often_as_the_dispersion_lets_it() -> None:
    # Angles scatter by σ about the target at distance d, so P(hit) = 1 − exp(−r² / (2 σ² d²)). Three standard errors
    # in eight cells: a right program would fail for one seed in 47.
    wide = replace(CONDITIONS, dispersion=np.deg2rad(1.0), muzzle_speed_sd=0.0, max_lateral_offset=0.0)
    static = table_suites(wide)[:4]
    trials = draw_trials(static * 2, 200, 10, seed=0)
    hit = perfect_shots(build_world(conditions=wide), trials).hits(wide.hit_radius).reshape(8, -1)
    distance = trials.engagements.motion.vertex[:, 0].reshape(8, -1)
    chance = 1.0 - np.exp(-(wide.hit_radius**2) / (2.0 * (wide.dispersion * distance) ** 2))
    expected, error = chance.mean(axis=1), np.sqrt((chance * (1 - chance)).mean(axis=1) / hit.shape[1])
    assert np.all(np.abs(hit.mean(axis=1) - expected) < 3.0 * error)


def test_perfect_aim_is_not_worse_than_a_controller(build_controller: Callable[..., Any], trials: Trials) -> None:
    world = build_world()
    perfect, kalman = perfect_shots(world, trials), fight(world, build_controller("kalman"), trials)
    assert perfect.hits(CONDITIONS.hit_radius).mean() > kalman.hits(CONDITIONS.hit_radius).mean()


def test_every_controller_meets_the_same_dispersion(build_controller: Callable[..., Any], trials: Trials) -> None:
    # A shot from nearly the same angles falls to nearly the same place, dispersion of many centimetres or not.
    world = build_world()
    perfect, kalman = perfect_shots(world, trials), fight(world, build_controller("kalman"), trials)
    close = np.abs(perfect.angle - kalman.angle).max(axis=-1) < 1e-3
    assert close.sum() > 50
    np.testing.assert_allclose(perfect.miss[close], kalman.miss[close], atol=0.01)


def test_the_largest_acceleration_by_hand() -> None:
    # From rest at zero with a period of 0.1 s: 0, 0, 0.01, 0.03, 0.02 rad has second differences 0.01, 0.01, −0.03,
    # so 1, 1 and 3 rad/s².
    yaw = np.array([0.01, 0.03, 0.02])
    angles = np.stack([np.zeros(3), yaw], axis=-1)[None].astype(np.float32)
    assert largest_acceleration(angles, 0.1, axis=1) == pytest.approx(3.0, rel=1e-5)
    assert largest_acceleration(angles[:, :1], 0.1, axis=1) == pytest.approx(1.0, rel=1e-5)
    assert largest_acceleration(angles, 0.1, axis=0) == 0.0


def test_a_hit_is_a_fired_shot_with_a_miss_distance_of_at_most_the_radius() -> None:
    miss = np.array([[[0.06, 0.0], [0.036, 0.048], [0.05, 0.05], [0.0, -0.0601], [0.0, 0.0], [np.nan, np.nan]]])
    fired = np.array([[True, True, True, True, False, False]])
    shots = Shots(fired, miss, miss, miss, ~fired)
    assert shots.hits(0.06 + 1e-9).tolist() == [[True, True, False, False, False, False]]


@pytest.mark.parametrize("name", ["kalman", "kalman-lq"])
def test_thousands_of_engagements_side_by_side_compile_to_the_shots_that_stepping_gives(build_controller, name) -> None:
    # Some releases of jaxlib sum wrongly in large batches on a CPU, with no warning: 500 engagements a cell are 4000.
    crowd = draw_trials(table_suites(CONDITIONS), engagements=500, decisions=3, seed=1)
    world, controller = build_world("box"), build_controller(name, "box")
    compiled, stepped = fight(world, controller, crowd), fight(Stepped(world), controller, crowd)
    np.testing.assert_allclose(compiled.miss, stepped.miss, atol=2e-3)
    np.testing.assert_allclose(compiled.angle, stepped.angle, atol=2e-4)
