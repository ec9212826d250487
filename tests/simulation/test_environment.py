import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.dynamics.array_namespace import single_precision
from archerfish.paper.conditions import assumed_conditions
from archerfish.sensing.interfaces import fire_always
from archerfish.sensing.observation import begin_memory, make_observer, observation_size, observe
from archerfish.simulation.environment import ShootingEnvironment
from archerfish.simulation.reward import Reward
from archerfish.simulation.scenario import draw_engagement
from archerfish.simulation.setting import make_scenario

LENGTH, BATCH = 5, 20


@pytest.fixture
def environment(build_world) -> ShootingEnvironment:
    world = build_world(draws=2)
    scenario = make_scenario(assumed_conditions(), static_share=0.5, plants=2)
    observer = single_precision(make_observer("history", world.muzzle))
    return ShootingEnvironment(world, scenario, observer, np.asarray(LENGTH))


def draws(environment: ShootingEnvironment, seed: int, batch: int = BATCH) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normals = rng.standard_normal((batch, environment.normals)).astype(np.float32)
    return normals, rng.random((batch, environment.uniforms)).astype(np.float32)


def still(batch: int = BATCH) -> np.ndarray:
    return np.zeros((batch, 2), np.float32)


def test_a_batch_begins_at_all_phases_of_an_engagement(environment) -> None:
    state, observation = environment.begin(*draws(environment, 1))
    assert np.bincount(state.step).tolist() == [BATCH // LENGTH] * LENGTH
    assert observation.shape == (BATCH, observation_size(environment.observer))


def test_phases_stay_mixed(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    for step in range(2 * LENGTH):
        state, outcome = environment.step(state, still(), *draws(environment, 2 + step))
        assert np.sum(outcome.truncated) == BATCH // LENGTH
        assert sorted(set(state.step)) == list(range(LENGTH))


def test_an_engagement_lasts_its_length_and_is_never_terminated(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    ends = []
    for step in range(3 * LENGTH):
        state, outcome = environment.step(state, still(), *draws(environment, 2 + step))
        ends.append(outcome.truncated)
        assert not outcome.terminated.any()
    for member in np.array(ends).T:
        assert np.all(np.diff(np.flatnonzero(member)) == LENGTH)


def test_the_last_observation_of_an_engagement_is_handed_out_beside_the_first_of_the_next(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    normals, uniforms = draws(environment, 2)
    following, outcome = environment.step(state, still(), normals, uniforms)
    ended = outcome.truncated
    assert ended.any()
    assert not ended.all()
    # The first observation of the next, drawn by itself.
    engagement = draw_engagement(environment.scenario, uniforms)
    fresh = environment.world.begin(engagement, normals)
    first = observe(environment.observer, begin_memory(environment.observer, environment.world.see(fresh)))
    assert_allclose(outcome.observation[ended], first[ended])
    assert_allclose(following.shooting.engagement.motion.vertex[ended], engagement.motion.vertex[ended])
    assert_allclose(following.shooting.time[ended], 0.0)
    assert np.all(following.step[ended] == 0)
    # The final one still belongs to the old engagement, whose target is elsewhere.
    lasting = ShootingEnvironment(*environment[:3], length=np.asarray(10**6))
    _, unbroken = lasting.step(state, still(), normals, uniforms)
    assert_allclose(outcome.final_observation, unbroken.observation)
    assert np.all(np.any(outcome.final_observation != outcome.observation, axis=1) == ended)
    assert_allclose(outcome.reward, unbroken.reward)


def test_every_engagement_has_targets_and_plants_of_its_own(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    vertices, plants = [], []
    for step in range(2 * LENGTH):
        state, outcome = environment.step(state, still(), *draws(environment, 2 + step))
        vertices.extend(state.shooting.engagement.motion.vertex[outcome.truncated, 0])
        plants.extend(state.shooting.engagement.plant[outcome.truncated])
    assert len(set(vertices)) == len(vertices) == 2 * BATCH
    assert set(plants) == {0, 1}


def test_zero_actions_aim_at_the_target_and_are_rewarded_for_it(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    lasting = ShootingEnvironment(*environment[:3], length=np.asarray(10**6))
    for step in range(40):
        # Without dispersion, and all targets with the plant of gain one.
        state, outcome = lasting.step(state, still(), 0.0 * draws(environment, 3)[0], draws(environment, 3 + step)[1])
    shooting = state.shooting
    alone = (shooting.engagement.plant == 0) & (shooting.engagement.motion.speed == 0.0)
    assert alone.any()
    # The printed pitch gain of 1.031 is all that is left of the error.
    assert np.all(outcome.reward[alone] > -0.03)


def test_the_same_draws_give_the_same_steps(environment) -> None:
    state, _ = environment.begin(*draws(environment, 1))
    outcomes = [environment.step(state, still(), *draws(environment, 2))[1] for _ in range(2)]
    for ours, theirs in zip(*outcomes, strict=True):
        assert np.array_equal(ours, theirs)


def test_numpy_and_jax_agree(environment, agree_in_jax) -> None:
    def both(environment, normals, uniforms, action):
        state, first = environment.begin(normals, uniforms)
        state, outcome = environment.step(state, action, normals, uniforms)
        return first, outcome, state.step

    action = np.random.default_rng(9).normal(0.0, 0.1, (BATCH, 2))
    # Observations magnify differences of nearly equal angles a hundred times.
    agree_in_jax(both, environment, *draws(environment, 4), action, rtol=1e-4, atol=2e-4)


def test_a_hit_adds_its_bonus_to_the_reward_and_a_miss_nothing(environment) -> None:
    bonus, radius = np.asarray(0.1, np.float32), np.asarray(0.06, np.float32)
    rewarded = environment._replace(reward=Reward(hit=bonus), hit_radius=radius, length=np.asarray(10**6))
    plain = environment._replace(length=np.asarray(10**6))
    state, _ = plain.begin(*draws(environment, 1))
    hits = 0
    for step in range(15):
        normals, uniforms = draws(environment, 2 + step)
        _, more = rewarded.step(state, still(), normals, uniforms)
        state, outcome = plain.step(state, still(), normals, uniforms)
        hit = outcome.reward >= -0.06  # eq (8): less the distance
        assert_allclose(more.reward, outcome.reward + np.where(hit, 0.1, 0.0), atol=1e-7)
        assert more.reward.dtype == np.float32
        hits += np.sum(hit)
    assert 20 < hits < 15 * BATCH - 20


def test_without_a_bonus_the_reward_is_eq_8(environment) -> None:
    assert environment.reward == Reward(distance=1.0, hit=0.0, width=0.0)
    state, _ = environment.begin(*draws(environment, 1))
    normals, uniforms = draws(environment, 2)
    command = environment.observer.decode(state.memory, still())
    _, shot = environment.world.shoot(state.shooting, fire_always(command), normals)
    _, outcome = environment.step(state, still(), normals, uniforms)
    assert_allclose(outcome.reward, -np.linalg.norm(shot.miss, axis=-1), rtol=1e-6)
