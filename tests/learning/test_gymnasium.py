"""The environment for other libraries: no transition is lost, and wrong things are answered as users expect."""

import copy
import os
import pickle
import re
import subprocess
import sys
from functools import partial
from pathlib import Path

import cloudpickle
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import archerfish as af
from archerfish.simulation import picture

gymnasium = pytest.importorskip("gymnasium")
pytest.importorskip("jax")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from archerfish.learning.gymnasium import ShootingEnv, ShootingVectorEnv  # noqa: E402

ROOT, ID = Path(__file__).parents[2], "archerfish.learning.gymnasium:archerfish/Shooting-v0"
MODES = list(gymnasium.vector.AutoresetMode)
TASK = af.Task.load("dynamic").replace(lengths_s=(0.1, 0.2), short_share=0.5)
PROCESSES = """
import sys, warnings, gymnasium
warnings.simplefilter("error")  # of numbers that are not in their space
warnings.filterwarnings("ignore", message=".*fork")
if __name__ == "__main__":
    name = "archerfish.learning.gymnasium:archerfish/Shooting-v0"
    gymnasium.make(name, task="paper").reset(seed=0)
    context = {"context": sys.argv[-1]}
    envs = gymnasium.make_vec(name, num_envs=2, vectorization_mode="async", vector_kwargs=context, task="paper")
    observation, _ = envs.reset(seed=3)
    print(observation.shape, observation.dtype, envs.step(envs.action_space.sample())[1].shape)
    envs.close()
"""
HANDED_OVER = """
import multiprocessing, warnings, gymnasium
warnings.simplefilter("ignore")
env = gymnasium.make("archerfish.learning.gymnasium:archerfish/Shooting-v0", task="paper")
env.reset(seed=0)
env.step(env.action_space.sample())
fork = multiprocessing.get_context("fork")
queue = fork.Queue()
process = fork.Process(target=lambda: queue.put(env.step(env.action_space.sample())[0].shape))
process.start()
print(queue.get(timeout=50))
"""


@pytest.fixture(scope="module")
def environment():
    return af.make_environment(task=TASK)


def test_gymnasium_finds_no_fault_in_it_and_it_has_the_environment_of_a_training():
    env = gymnasium.make(ID, task="paper", render_mode="rgb_array")
    check_env(env.unwrapped)
    assert env.reset(seed=1)[0].shape == (35,)
    assert gymnasium.make(ID).reset(seed=1)[0].shape == (120,)  # as `train` takes it
    envs = gymnasium.make_vec(ID, num_envs=3, task="paper")
    assert isinstance(envs.unwrapped, ShootingVectorEnv)
    assert envs.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.SAME_STEP


def alone(environment, seed):
    """Play one engagement after the other straight in the environment: (observation, step) with actions sent in."""
    generator, _ = gymnasium.utils.seeding.np_random(seed)
    (noise,), step, length = generator.spawn(1), None, 0
    while True:
        normals = generator.standard_normal((1, environment.normals), np.float32)
        state, observation = environment.fresh(normals, generator.random((1, environment.uniforms), np.float32))
        action, length = (yield observation[0], step, length), 0
        while True:
            normals = noise.standard_normal((1, environment.normals), np.float32)
            before = (state, observation)
            state, step = environment.step(state, np.clip(action, -1, 1)[None], normals, before)
            length += 1
            if step.truncated[0]:
                break
            action = yield step.observation[0], step, length


@pytest.mark.parametrize("steps", [60, pytest.param(10_000, marks=pytest.mark.slow)])
def test_no_transition_is_lost_or_repeated(environment, steps):
    env, rng, lengths = ShootingEnv(environment=environment), np.random.default_rng(0), set()
    (observation, _), game = env.reset(seed=10), alone(environment, 10)
    expected, *_ = next(game)
    for _ in range(steps):
        assert_allclose(observation, expected, atol=2e-3)
        action = rng.uniform(-1.2, 1.2, 2).astype(np.float32)
        observation, reward, terminated, truncated, info = env.step(action)
        expected, given, length = game.send(action)
        assert (terminated, truncated) == (False, given.truncated[0])
        assert_allclose(observation, given.final_observation[0], atol=2e-3)
        assert_allclose([reward, *info["miss"]], [given.reward[0], *given.shot.miss[0]], atol=1e-3)
        if truncated:
            lengths.add(length)
            observation, _ = env.reset()
    assert lengths == {5, 10}


@pytest.mark.parametrize("mode", MODES)
def test_every_autoreset_mode_is_that_of_gymnasium_s_own_vector_environment(environment, mode):
    ours = ShootingVectorEnv(3, environment=environment, autoreset_mode=mode.name)
    theirs = gymnasium.vector.SyncVectorEnv([lambda: ShootingEnv(environment=environment)] * 3, autoreset_mode=mode)
    both, rng, disabled = (ours, theirs), np.random.default_rng(0), mode.name == "DISABLED"
    assert ours.metadata["autoreset_mode"] is theirs.metadata["autoreset_mode"] is mode

    def agree(one, other):
        for name in one.keys() | other.keys():
            shown = one.get(f"_{name}", np.ones(3, bool))
            for member in np.flatnonzero(shown) if name[0] != "_" else ():
                equal = agree if isinstance(one[name], dict) else partial(assert_allclose, atol=2e-3)
                equal(*((each if equal is agree else each[member]) for each in (one[name], other[name])))
            assert_array_equal(shown, other.get(f"_{name}", shown))

    agree(*({"first": envs.reset(seed=10)[0]} for envs in both))
    ended = np.zeros(3, bool)
    for place in range(60):
        for member in np.flatnonzero(ended) if disabled else ():  # one after the other
            with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
                ours.step(np.zeros((3, 2)))
            mask = np.arange(3) == member
            agree(*({"first": envs.reset(options={"reset_mask": mask.copy()})[0]} for envs in both))
        if place in (13, 33):  # in the middle of engagements: the second one goes on, and then begins with a new seed
            mask, seed = np.array([place == 13, place == 33, True]), None if place == 13 else [None, 5, None]
            agree(*({"first": envs.reset(seed=seed, options={"reset_mask": mask.copy()})[0]} for envs in both))
        action = rng.uniform(-1.2, 1.2, (3, 2)).astype(np.float32)
        (*given, infos), (*expected, others) = (envs.step(action) for envs in both)
        for one, other in zip(given, expected, strict=True):
            assert_allclose(one, other, atol=2e-3)
        agree(infos, others)
        ended = given[3]


def test_new_engagements_are_drawn_once_a_block_and_not_at_every_step(environment, monkeypatch):
    monkeypatch.setattr("archerfish.learning.gymnasium.forked", [True])  # in NumPy, where each call is counted
    envs, drawn, draw = ShootingVectorEnv(4, environment=environment), [], type(environment.scenario).draw
    monkeypatch.setattr(type(environment.scenario), "draw", lambda *given: drawn.append(1) or draw(*given))
    envs.reset(seed=0)
    for _ in range(60):
        observations, rewards, *_ = envs.step(np.zeros((4, 2), np.float32))
    assert observations.dtype == rewards.dtype == np.float32
    assert len(drawn) <= 2 + 60 / 5  # no engagement is shorter than five decisions


def test_seeds_repeat_and_differ_and_a_batch_may_be_staggered(environment):
    envs = ShootingVectorEnv(3, environment=environment, staggered=True)
    first = envs.reset(seed=5)[0]
    for seed in ([5, 6, 7], np.array([5, 6, 7]), np.int64(5)):
        assert_array_equal(first, envs.reset(seed=seed)[0])
    assert envs.np_random_seed == 5
    assert not np.array_equal(envs.reset()[0], first)
    assert len(np.unique(first, axis=0)) == 3
    ended = np.any([envs.step(np.zeros((3, 2), np.float32))[3] for _ in range(4)], axis=0)
    assert ended[2]  # of 5 or 10 decisions, 0.6 are cut off


def test_actions_beyond_the_bound_are_clipped_and_what_is_no_action_is_refused(environment, refused):
    env = ShootingEnv(environment=environment, action_bound=0.5)
    rewards = []
    for action in ([9.0, -9.0], np.array([0.5, -0.5]), np.array([1, -1]), np.array([1e300, -1e300])):
        env.reset(seed=0)  # lists, float64 and integers, too
        rewards.append(env.step(action)[1])
    assert len(set(rewards)) == 1
    wrong = {"float64 of shape (3,)": np.zeros(3), "<U1 of": np.array(["a", "b"]), "bool of": np.array([True, False])}
    wrong |= {"a number that is not finite": np.array([np.nan, 0.0]), "object of": [[0.0], 0.0], "object of s": None}
    for what, action in wrong.items():
        refused(re.escape(f"finite numbers of shape (2,), pitch and yaw, got {what}"), env.step, action)
    envs = ShootingVectorEnv(3, environment=environment)
    envs.reset(seed=0)
    refused("of shape .3, 2., pitch and yaw, got float64 of shape .2,", envs.step, [0.0, 0.0])
    while not env.step(np.zeros(2, np.float32))[3]:
        pass
    for each in (env, ShootingEnv(environment=environment), ShootingVectorEnv(2, environment=environment)):
        with pytest.raises(gymnasium.error.ResetNeeded):
            each.step(np.zeros(2, np.float32))


def test_what_can_not_be_made_or_reset_is_named(environment, refused):
    refused("options robot, task, .* staggered, autoreset_mode; got plant", ShootingEnv, plant="x")
    refused("got render_mode 'human'", ShootingEnv, "human")
    refused("an environment is given, so task", ShootingEnv, environment=environment, task="paper")
    refused("environment must be from make_environment, got 3", ShootingEnv, environment=3)
    refused("action_bound must be finite and > 0, got 0", ShootingEnv, environment=environment, action_bound=0)
    refused("num_envs must be at least 1, got 0", ShootingVectorEnv, 0)
    envs = ShootingVectorEnv(2, environment=environment)
    refused("seed must be an integer of at least 0, got -1", envs.reset, seed=[0, -1])
    refused("seed must be one per environment: expected 2, got 3", envs.reset, seed=[1, 2, 3])
    refused("reset takes reset_mask alone, got speed", envs.reset, options={"speed": 1})
    refused("reset_mask must be bool of shape .2,., all at first", envs.reset, options={"reset_mask": [True]})
    refused("reset takes no options, got speed", ShootingEnv(environment=environment).reset, options={"speed": 1})
    refused("must be one of NEXT_STEP, SAME_STEP, DISABLED, got 'next'", ShootingVectorEnv, autoreset_mode="next")
    refused("of the task is 10, got 9", ShootingVectorEnv, environment=environment, max_episode_steps=9)


def test_a_picture_shows_gimbal_target_and_pellets(environment):
    envs = ShootingVectorEnv(3, render_mode="rgb_array", environment=environment)
    envs.reset(seed=0)
    before = envs.render()
    envs.step(np.ones((3, 2), np.float32))
    after = envs.render()
    assert before[0].shape == (picture.HEIGHT, picture.FIELD_WIDTH + picture.NEAR_WIDTH, 3)
    assert all(np.any(one != other) for one, other in zip(before, after, strict=True))
    drawn = picture.draw_picture((0.1, 0.2), (0.0, 0.0), (3.0, 0.0, 0.0), [(0.0, 0.0), (9.0, 9.0)], 0.06)
    rows, columns = np.nonzero(np.all(drawn[:, : picture.FIELD_WIDTH] == picture.GIMBAL, axis=-1))
    assert rows.mean() < picture.HEIGHT / 2  # muzzle up
    assert columns.mean() < picture.FIELD_WIDTH / 2  # to the left


def test_between_frames_a_picture_shows_the_plate_where_it_is(monkeypatch):
    robot, plates = af.Robot.load("tests/infantry"), []
    sensing = robot.sensing.replace(camera=robot.sensing.camera.replace(rate_hz=30.0))
    monkeypatch.setattr("archerfish.learning.gymnasium.draw_picture", lambda _, __, plate, *___: plates.append(plate))
    env = ShootingEnv("rgb_array", robot=robot.replace(sensing=sensing), task="static")
    env.reset(seed=0)
    for _ in range(6):
        env.step(np.zeros(2, np.float32))
        env.render()
    assert_array_equal(plates, plates[:1] * 6)


def test_wrappers_of_gymnasium_count_every_engagement(environment):
    wrappers, options = gymnasium.wrappers.vector, {"environment": environment, "autoreset_mode": "NEXT_STEP"}
    envs = wrappers.RecordEpisodeStatistics(gymnasium.make_vec(ID, num_envs=4, **options))
    envs = wrappers.NormalizeReward(wrappers.NormalizeObservation(envs))
    first, _ = envs.reset(seed=0)
    assert envs.observation_space.contains(first)
    lengths = []
    for _ in range(40):
        *_, ended, infos = envs.step(envs.action_space.sample())
        lengths += infos["episode"]["l"][ended].tolist() if ended.any() else []
    assert (set(lengths), len(lengths) > 12) == ({5, 10}, True)


def test_a_spec_has_the_longest_engagement_and_makes_the_environment_again(environment):
    env = gymnasium.make(ID, task="paper")
    assert (env.spec.max_episode_steps, gymnasium.make(ID, environment=environment).spec.max_episode_steps) == (50, 10)
    spec = gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert_array_equal(spec.make().reset(seed=3)[0], env.reset(seed=3)[0])
    envs = gymnasium.make_vec(env.spec, num_envs=2)
    assert (envs.num_envs, envs.unwrapped.environment.scenario.motion) == (2, "paper")
    with pytest.raises(TypeError, match="Robot is not JSON serializable"):  # documented: names, not objects
        gymnasium.make(ID, robot=af.Robot.paper(), task="paper").spec.to_json()


COPIES = [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env)), lambda env: pickle.loads(cloudpickle.dumps(env))]


@pytest.mark.parametrize("copied", COPIES)
@pytest.mark.parametrize("make", [gymnasium.make, gymnasium.make_vec])
def test_a_copy_of_an_environment_goes_on_as_the_environment_does(environment, copied, make):
    env = make(ID, environment=environment)
    env.reset(seed=1)
    env.step(env.action_space.sample())
    other, action = copied(env), env.action_space.sample()
    for _ in range(4):
        assert_array_equal(env.step(action)[0], other.step(action)[0])
    assert_array_equal(env.reset()[0], other.reset()[0])


@pytest.mark.parametrize("copied", COPIES)
def test_a_copy_of_the_environments_for_stable_baselines_goes_on_as_they_do(environment, copied):
    pytest.importorskip("stable_baselines3", reason="stable_baselines3 is not installed")
    from archerfish.learning.stable_baselines import ShootingVecEnv

    envs, actions = ShootingVecEnv(3, environment=environment), np.float32([[0.1, -0.2]] * 3)
    envs.reset()
    envs.step(actions)
    other = copied(envs)
    for _ in range(6):  # an engagement ends within five decisions
        assert_array_equal(envs.step(actions)[0], other.step(actions)[0])


@pytest.mark.parametrize("mode", ["NEXT_STEP", "DISABLED"])
def test_wrappers_of_gymnasium_that_change_observations_take_the_modes_of_the_page(environment, mode):
    wrappers = gymnasium.wrappers.vector
    envs = gymnasium.make_vec(ID, num_envs=2, environment=environment, autoreset_mode=mode)
    envs = wrappers.DtypeObservation(wrappers.FlattenObservation(envs), np.float32)
    assert envs.reset(seed=0)[0].dtype == np.float32
    assert envs.step(envs.action_space.sample())[0].shape == (2, 35)
    if mode == "DISABLED":
        with pytest.raises(ValueError, match=r"NEXT_STEP, got .*DISABLED"):
            wrappers.NormalizeObservation(envs)


@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_environments_in_processes_of_their_own_answer(context, tmp_path):
    (tmp_path / "program.py").write_text(PROCESSES)
    words = [sys.executable, tmp_path / "program.py", context]
    surroundings = {**os.environ, "PYTHONPATH": str(ROOT / "src")}
    printed = subprocess.check_output(words, text=True, env=surroundings, timeout=100)
    assert printed == "(2, 35) float32 (2,)\n"


def test_an_environment_that_is_handed_to_a_forked_process_answers(run_python):
    assert run_python(HANDED_OVER, timeout_s=60) == "(35,)\n"


SHORT = "archerfish/Shooting-v0"
ORDERS = [
    ("import archerfish; assert 'gymnasium' not in sys.modules; import gymnasium", ID),
    ("import gymnasium, archerfish; assert not {'jax', 'archerfish.robot'} & sys.modules.keys()", SHORT),
    ("import gymnasium", ID),
    ("import gymnasium", f"archerfish:{SHORT}"),
    ("import archerfish.learning.gymnasium, gymnasium", SHORT),
    ("import gymnasium, archerfish, importlib; importlib.reload(archerfish)", ID),
]


@pytest.mark.parametrize(("imports", "name"), ORDERS)
def test_gymnasium_has_the_name_in_any_order_of_imports(imports, name, run_python):
    made = f"gymnasium.make({name!r}, task='paper').spec.id"
    assert run_python(f"import sys, warnings; warnings.simplefilter('error'); {imports}; print({made})") == f"{SHORT}\n"


SMALL = {"num_envs=64": "num_envs=4", "range(1000)": "range(60)", "batch_size=1600": "batch_size=50", "[256]": "[16]"}
SMALL |= {"learn(3_000_000)": "learn(200)", "engagements=100": "engagements=2", "Env(512": "Env(8"}


@pytest.mark.parametrize("package", ["gymnasium", "stable_baselines3"])
def test_the_page_runs(package, monkeypatch, tmp_path):
    pytest.importorskip(package, reason=f"{package} is not installed")
    monkeypatch.setattr("archerfish.evaluation.tuning_search.rates", lambda *_: lambda settings: 0.5)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "gymnasium.md").read_text(), re.DOTALL)
    assert ["stable_baselines3" in each for each in blocks] == [False] * 4 + [True]
    code = "".join(each for each in blocks if ("stable_baselines3" in each) is (package != "gymnasium"))
    for usual, small in SMALL.items():
        code = code.replace(usual, small)
    exec(code, {})
