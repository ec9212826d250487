"""Whether PPO of Stable-Baselines3 learns in our vector environment, and what checkers say about our environments.

`python benchmarks/learn_elsewhere.py` trains for 100,000 decisions with the settings of docs/gymnasium.md, in the
paper's task under `box`, and lets untrained and trained models shoot at the same targets, as the uncompiled controllers
that users get. Each trained model is saved and loaded again before. Goals: the mean hit rate of every trained model is
above that of the untrained one, beyond both 95 % intervals, and within a point of its hits without exploration in its
own environment; `check_env` of Gymnasium and of Stable-Baselines3 warn of nothing, nor do Gymnasium's vector wrappers
in any autoreset mode. Writes results/learn_elsewhere.json.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path
from typing import Any

import peers

RESULT = Path(__file__).parent / "results" / "learn_elsewhere.json"
ID = "archerfish.learning.gymnasium:archerfish/Shooting-v0"
STEPS, SEEDS, ENGAGEMENTS = 100_000, (0, 1, 2), 200


def trained(environment: Any, steps: int, seed: int, engagements: int) -> tuple[Any, float]:
    """Return a controller after so many decisions, rounded up to whole batches, and its share of hits in training."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

    from archerfish.authors import Player
    from archerfish.learning.stable_baselines import ShootingVecEnv

    def fresh(count: int, staggered: bool) -> Any:
        return VecMonitor(ShootingVecEnv(count, environment=environment, staggered=staggered))

    envs = VecNormalize(fresh(512, True), norm_reward=False)
    settings = {"n_steps": 25, "batch_size": 1600, "n_epochs": 4, "gamma": 0.95, "gae_lambda": 0.9, "device": "cpu"}
    policy = {"net_arch": [256], "log_std_init": -1.0}
    model = PPO("MlpPolicy", envs, policy_kwargs=policy, seed=seed, **settings)
    if steps:
        model.learn(steps)
    with tempfile.TemporaryDirectory() as folder:
        model.save(f"{folder}/model")
        envs.save(f"{folder}/normaliser")
        model = PPO.load(f"{folder}/model")
        envs = VecNormalize.load(f"{folder}/normaliser", fresh(engagements, False))
    envs.training = False
    return Player(model, environment.observer, envs.normalize_obs), hit_share(model, envs)


def hit_share(model: Any, envs: Any) -> float:
    """Return the share of hits of a model without exploration, over a whole engagement of each environment."""
    observation, hits = envs.reset(), []
    for _ in range(50):
        observation, _, _, infos = envs.step(model.predict(observation, deterministic=True)[0])
        hits.append([info["hit"] for info in infos])
    return float(sum(map(sum, hits))) / sum(map(len, hits))


def complaints() -> list[str]:
    """Return what the checkers of both libraries warn of; a fault ends the benchmark."""
    import gymnasium
    from gymnasium.utils.env_checker import check_env
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        for task in ("paper", "any"):
            env = gymnasium.make(
                "archerfish.learning.gymnasium:archerfish/Shooting-v0", task=task, render_mode="rgb_array"
            )
            check_env(env.unwrapped)
            check_for_sb3(env)
            check_for_sb3(env.unwrapped)
        for mode in gymnasium.vector.AutoresetMode:
            envs = gymnasium.make_vec(ID, num_envs=8, task="paper", autoreset_mode=mode)
            envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(envs)
            if mode.name == "NEXT_STEP":
                envs = gymnasium.wrappers.vector.NormalizeObservation(envs)
            envs.reset(seed=0)
            for _ in range(120):
                *_, ended, _ = envs.step(envs.action_space.sample())
                if mode.name == "DISABLED" and ended.any():
                    envs.reset(options={"reset_mask": ended})
    return [str(each.message) for each in found]


def compare(steps: int, seeds: tuple[int, ...], engagements: int) -> dict[str, Any]:
    """Train, and return hit rates with intervals by controller."""
    import archerfish as af
    from archerfish.evaluation.tables import mean

    task = af.Task.load("paper").replace(command_limit="box")
    environment = af.make_environment(task=task)
    models = {"untrained": trained(environment, 0, seeds[0], 8 * engagements)}
    models |= {f"seed {seed}": trained(environment, steps, seed, 8 * engagements) for seed in seeds}
    controllers = {name: player for name, (player, _) in models.items()}
    results = af.evaluate(controllers, task=task, engagements=engagements, seed=0)
    print(results)
    found: dict[str, Any] = {}
    for name in controllers:
        cells = [each for each in results.cells if each.controller == name]
        rates = {"mean": (mean(cells) or ())[:3], "in training": (100.0 * models[name][1],)}
        for each in cells:
            cell = f"{each.motion}, {each.range_m[0]:g}–{each.range_m[1]:g} m"
            rates[cell] = 100.0 * each.rate, 100.0 * each.low, 100.0 * each.high
        found[name] = {cell: [round(end, 2) for end in rate] for cell, rate in rates.items()}
    return found


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=Path, help="one that has the peers; they are installed if not given")
    parser.add_argument("--quick", action="store_true", help="one seed and few engagements; nothing is written")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.inside:
        words = [peers.interpreter(options.python), __file__, "--inside", *["--quick"] * options.quick]
        raise SystemExit(subprocess.run(words, env=peers.SURROUNDINGS, check=False).returncode)
    seeds, engagements = (SEEDS[:1], 20) if options.quick else (SEEDS, ENGAGEMENTS)
    found, said = compare(STEPS, seeds, engagements), complaints()
    print(*said or ["no warning of check_env"], sep="\n")
    if not options.quick:
        conditions = {"steps": STEPS, "engagements": engagements, "command_limit": "box", "observation": "history",
                      "cores": os.cpu_count(), "machine": platform.machine(), "load": round(os.getloadavg()[0], 1),
                      "versions": peers.versions(sys.executable)}  # fmt: skip
        content = {"conditions": conditions, "rate_low_high_percent": found, "warnings_of_check_env": said}
        RESULT.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")
    high = found["untrained"]["mean"][2]
    below = [name for name, rates in found.items() if name != "untrained" and rates["mean"][1] <= high]
    apart = {name: abs(rates["mean"][0] - rates["in training"][0]) for name, rates in found.items()}
    print(*(f"{name}: {points:.2f} points from its training" for name, points in apart.items()), sep="\n")
    if below or said or max(apart.values()) > 1.0:
        raise SystemExit(f"missed: not above the untrained model: {below}; warnings: {len(said)}; {apart}")


if __name__ == "__main__":
    main()
