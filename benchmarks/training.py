"""Decisions per second of trainings, and of the environment alone.

`python benchmarks/training.py [--against REVISION]`: PPO with its default settings in the paper's task, the gradient
trainer with its defaults for `kinds` on tests/infantry, and 512 engagements of the environment without a policy, in
the loop and the shards of a training. The machine should do nothing else. Writes results/training.json.
"""

import importlib
from collections.abc import Callable
from typing import Any

import alternating

MEMBERS, STEPS, SHARDS, CALLS = 512, 100, 2, 4
NAMES = ("ppo, paper", "gradient, kinds", "environment")


def prepare() -> alternating.Work:
    """Return name → a training or the environment alone, which return how many decisions."""
    from archerfish.compiled import import_jax

    jax = import_jax()
    from archerfish.learning import learner, shards
    from archerfish.learning.config import TrainConfig
    from archerfish.learning.environment import make_environment
    from archerfish.learning.gradient import GRADIENT
    from archerfish.learning.ppo import PPO
    from archerfish.robot import Robot
    from archerfish.task import Task

    shards.claim_devices(SHARDS)

    def training(trainer: Any, environment: Any, config: Any) -> Callable[[], int]:
        environment = jax.tree.map(jax.numpy.asarray, environment)
        state = shards.placed(trainer.begin(environment, config, jax.random.key(0)), config.shards, learner.SPLIT)
        return _repeated(lambda state: trainer.advance(environment, config, state, CALLS)[0], state, config.batch)

    robots = Robot.paper(), Robot.load(alternating.ROOT / "tests" / "infantry")
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
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=7)
