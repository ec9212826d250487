"""Decisions per second of trainings, and of the environment alone, against the first edition.

Each edition runs in a process of its own; the two alternate, and medians of the pairs are compared:
`python benchmarks2/training.py`. PPO with its default settings in the paper's task, the gradient trainer with its
defaults for `kinds` on tests2/infantry (the first edition's `any`), and 512 engagements of the environment without a
policy, in the loop and the shards of a training. Goals: 0.97, 1.15 and 0.97 of the first edition's figures. The machine
should do nothing else. Writes results/training.json.
"""

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import alternating

ROOT = Path(__file__).parents[1]
INFANTRY = ROOT.parent / "shared" / "second_edition" / "reference" / "infantry"
MEMBERS, STEPS, SHARDS, CALLS = 512, 100, 2, 4


def first_edition() -> dict[str, Callable[[], int]]:
    """Return what is measured of the first edition: name → a function that returns how many decisions."""
    from archerfish.cli.setting import SettingFiles, load_setting
    from archerfish.cli.training_run import TrainingTask, _environment
    from archerfish.learning.config import PpoConfig
    from archerfish.learning.gradient import GRADIENT
    from archerfish.learning.gradient_config import GradientConfig
    from archerfish.learning.ppo import SPLIT
    from archerfish.learning.shards import claim_devices, over_shards, own_key, placed
    from archerfish.learning.training import PPO, Trainer

    claim_devices(SHARDS)
    jax: Any = importlib.import_module("jax")

    def training(trainer: Trainer, environment: Any, config: Any) -> Callable[[], int]:
        environment = jax.tree.map(jax.numpy.asarray, environment)
        state = placed(trainer.begin(environment, config, jax.random.key(0)), config.shards, SPLIT)
        return _repeated(lambda learner: trainer.advance(environment, config, learner, CALLS)[0], state, config.batch)

    names: dict[str, Any] = {
        name: INFANTRY / f"{name}.json" for name in ("pitch", "yaw", "muzzle", "sensing", "limits")
    }
    paper, infantry = load_setting(SettingFiles()), load_setting(SettingFiles(**names, robot="infantry"))
    ppo, gradient = PpoConfig(), GradientConfig(steps=9_000_000, hidden=512)
    usual: dict[str, Any] = {"frames": 4, "command_limit": "gate", "ppo": ppo, "seed": 0, "gradient": gradient}
    in_paper = _environment(TrainingTask(setting=paper, static_share=0.5, observation="history", **usual))
    task = TrainingTask(
        setting=infantry, static_share=0.0, observation="multimodel", trainer="gradient", target="any", **usual
    )

    def stepped(environment: Any, state: Any, key: Any) -> Any:
        keys, own = jax.random.split(own_key(key), 2), MEMBERS // SHARDS
        normals = jax.random.normal(keys[0], (STEPS, environment.normals, own))
        uniforms = jax.random.uniform(keys[1], (STEPS, environment.uniforms, own))

        def step(state: Any, draws: Any) -> Any:
            state, outcome = environment.step(state, jax.numpy.zeros((own, 2)), *(each.T for each in draws))
            return state, (outcome.observation, outcome.final_observation, outcome.reward)

        return jax.lax.scan(step, state, (normals, uniforms))

    return {
        "ppo, paper": training(PPO, in_paper, ppo),
        "gradient, kinds": training(GRADIENT, _environment(task), gradient),
        "environment": _environment_alone(in_paper, stepped, over_shards),
    }


def second_edition() -> dict[str, Callable[[], int]]:
    """Return the same of the second edition."""
    from archerfish2.compiled import import_jax

    jax = import_jax()
    from archerfish2.learning import learner, shards
    from archerfish2.learning.config import TrainConfig
    from archerfish2.learning.environment import make_environment
    from archerfish2.learning.gradient import GRADIENT
    from archerfish2.learning.ppo import PPO
    from archerfish2.robot import Robot
    from archerfish2.task import Task

    shards.claim_devices(SHARDS)

    def training(trainer: Any, environment: Any, config: Any) -> Callable[[], int]:
        environment = jax.tree.map(jax.numpy.asarray, environment)
        state = shards.placed(trainer.begin(environment, config, jax.random.key(0)), config.shards, learner.SPLIT)
        return _repeated(lambda state: trainer.advance(environment, config, state, CALLS)[0], state, config.batch)

    robots = Robot.paper(), Robot.load(ROOT / "tests2" / "infantry")
    tasks = Task.load("paper"), Task.load("kinds")
    settings = TrainConfig(trainer="ppo", observation="history"), TrainConfig()
    ready = [each.resolved(robot, task) for each, robot, task in zip(settings, robots, tasks, strict=True)]
    in_paper = make_environment(robots[0], tasks[0], config=ready[0])
    in_kinds = make_environment(robots[1], tasks[1], config=ready[1])

    def stepped(environment: Any, state: Any, key: Any) -> Any:
        keys, own = jax.random.split(shards.own_key(key), 2), MEMBERS // SHARDS
        normals = jax.random.normal(keys[0], (STEPS, environment.normals, own))
        # Blocks no longer than an engagement, as in a training, whose window draws what replaces the ended ones.
        blocks = normals.reshape(STEPS // 25, 25, *normals.shape[1:])

        def block(state: Any, drawn: Any) -> Any:
            fresh = learner.fresh_engagements(environment, jax.random.fold_in(keys[1], drawn[1]), own)

            def step(state: Any, normals: Any) -> Any:
                state, step = environment.step(state, jax.numpy.zeros((own, 2)), normals.T, fresh)
                return state, (step.observation, step.final_observation, step.reward)

            return jax.lax.scan(step, state, drawn[0])

        return jax.lax.scan(block, state, (blocks, jax.numpy.arange(len(blocks))))

    return {
        "ppo, paper": training(PPO, in_paper, ready[0].ppo),
        "gradient, kinds": training(GRADIENT, in_kinds, ready[1].gradient),
        "environment": _environment_alone(in_paper, stepped, shards.over_shards),
    }


def _repeated(advance: Callable[[Any], Any], state: Any, batch: int) -> Callable[[], int]:
    jax: Any = importlib.import_module("jax")
    held = [state]

    def run() -> int:
        held[0] = jax.block_until_ready(advance(held[0]))
        return CALLS * batch

    return run


def _environment_alone(environment: Any, stepped: Callable[..., Any], over_shards: Any) -> Callable[[], int]:
    jax: Any = importlib.import_module("jax")
    environment = jax.tree.map(jax.numpy.asarray, environment)
    drawn = (jax.random.normal(jax.random.key(0), (MEMBERS, environment.normals)),
             jax.random.uniform(jax.random.key(1), (MEMBERS, environment.uniforms)))  # fmt: skip
    state = jax.jit(lambda made, *draws: made.begin(*draws)[0])(environment, *drawn)
    run = jax.jit(over_shards(stepped, SHARDS, (False, True, False), True))

    def once() -> int:
        jax.block_until_ready(run(environment, state, jax.random.key(1)))
        return STEPS * MEMBERS

    return once


if __name__ == "__main__":
    NAMES = ("ppo, paper", "gradient, kinds", "environment")
    alternating.run(__doc__, __file__, {"first": first_edition, "second": second_edition}, NAMES, pairs=7)
