"""Decisions per second of PPO against Stable-Baselines3 and Brax, in the paper's task and our environment.

Equal environment (command limit `box`, observation `paper`), network, batch, epochs and minibatches. Each library
trains in processes of its own, one for each number of threads or devices that it may be fastest with; they take turns,
and the medians of each library's best process are compared: `python benchmarks/training_peers.py`. Goals: 6 times
Stable-Baselines3, 2.2 times Brax. Where they differ: both peers have one learning rate, which does not fall, and clip
the gradients of both networks as one; Brax leaves out the step at which an engagement's time is up. The machine should
do nothing else. Writes results/training_peers.json.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
from pathlib import Path
from typing import Any

import peers
import ppo_workers
from ppo_workers import BRAX, OURS, SB3

RESULT = Path(__file__).parent / "results" / "training_peers.json"
WORKERS = ((OURS, 2), (SB3, 1), (SB3, 2), (BRAX, 1), (BRAX, 2))
"""Library, and its threads (Stable-Baselines3) or devices of JAX."""
GOALS = {SB3: 6.0, BRAX: 2.2}


def main() -> None:
    """Measure, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", type=Path, help="one that has the peers; they are installed if not given")
    parser.add_argument("--observation", default="paper")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each turn")
    parser.add_argument("--quick", action="store_true", help="one short round; nothing is written")
    parser.add_argument("--worker", nargs=2, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        ppo_workers.work(options.worker[0], int(options.worker[1]), options.observation)
        return
    rounds, seconds = (1, 1.0) if options.quick else (options.rounds, options.seconds)
    python, load = peers.interpreter(options.python), os.getloadavg()[0]
    rates = measure(python, options.observation, rounds, seconds)
    medians = {worker: statistics.median(found) for worker, found in rates.items()}
    rows: dict[str, Any] = {}
    for name in (OURS, *GOALS):
        own = {worker[1]: medians[worker] for worker in WORKERS if worker[0] == name}
        best = max(own, key=lambda threads: own[threads])
        ratios = [ours / theirs for ours, theirs in zip(rates[WORKERS[0]], rates[name, best], strict=True)]
        rows[name] = {"per_second": {threads: round(rate) for threads, rate in own.items()}, "best": best}
        rows[name] |= {"ours_over_it": round(statistics.median(ratios), 3), "goal": GOALS.get(name)}
        rows[name]["rounds"] = [round(rate) for rate in rates[name, best]]
        by_threads = ", ".join(f"{rate:,.0f} with {threads}" for threads, rate in own.items())
        print(f"{name:18} {by_threads:34} ours over it {rows[name]['ours_over_it']:6.2f}   goal {GOALS.get(name, 1.0)}")
    if options.quick:
        return
    settings = {"observation": options.observation, "command_limit": "box", "rounds": rounds, "turn_s": seconds}
    machine = {"cores": os.cpu_count(), "machine": platform.machine(), "load_before": round(load, 1)}
    conditions = {
        **settings,
        **machine,
        "versions": {"ours": peers.versions(sys.executable), "peers": peers.versions(python)},
    }
    RESULT.write_text(json.dumps({"conditions": conditions, "decisions": rows}, indent=1) + "\n")
    missed = [f"{name}: {rows[name]['ours_over_it']}, goal {goal}" for name, goal in GOALS.items()
              if rows[name]["ours_over_it"] < goal]  # fmt: skip
    if missed:
        raise SystemExit(f"missed: {'; '.join(missed)}")


def measure(python: str, observation: str, rounds: int, seconds: float) -> dict[tuple[str, int], list[float]]:
    """Let all workers train in turns; worker → its decisions per second in each round."""
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True, "env": peers.SURROUNDINGS}
    processes: dict[tuple[str, int], Any] = {}
    for name, threads in WORKERS:
        words = [sys.executable if name == OURS else python, __file__, "--observation", observation]
        processes[name, threads] = subprocess.Popen([*words, "--worker", name, str(threads)], **pipes)

    def measured(worker: tuple[str, int]) -> float:
        while line := processes[worker].stdout.readline():
            if line.startswith("["):
                count, spent = json.loads(line)
                return float(count / spent)
        raise SystemExit(f"the process of {worker[0]} ended")

    def turn(worker: tuple[str, int]) -> float:
        processes[worker].stdin.write(f"{seconds}\n")
        processes[worker].stdin.flush()
        return measured(worker)

    try:
        for ask in (measured, turn):  # until all is compiled, then warm
            for worker in WORKERS:
                ask(worker)
        orders = (WORKERS[:: 1 if number % 2 else -1] for number in range(rounds))
        done = [{worker: turn(worker) for worker in order} for order in orders]
    finally:
        for process in processes.values():
            process.terminate()
    return {worker: [rates[worker] for rates in done] for worker in WORKERS}


if __name__ == "__main__":
    main()
