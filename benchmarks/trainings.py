"""Whether the policy's place among the classical controllers is that of one training: three of them, all limits.

    python benchmarks/trainings.py

Tables II and III in the simulator of the printed gimbal: policies with the settings of `archerfish reproduce`, training
seeds 0, 1 and 2 under each command limit, in the engagements of `reproduce` at seed 0. Writes
benchmarks/results/trainings.json; the exit status is 1 if a bar of `policy_place` is missed.
"""

import sys
from pathlib import Path
from typing import Any

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.evaluation_run import EvaluationTask, make_ground, run_bounds, run_evaluation
from archerfish.cli.hit_rate_stage import AGAINST, COMMAND_LIMITS
from archerfish.cli.reproduce import Reproduce
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.cli.training_run import TrainingTask, run_task
from archerfish.cli.workers import Task, run_tasks
from archerfish.evaluation.evaluate import cells, comparisons
from archerfish.records import storage
from archerfish.records.provenance import provenance
from archerfish.sensing.observation import DEFAULT_FRAMES
from machine import describe_machine
from policy_place import places, show

RESULT = Path(__file__).parent / "results" / "trainings.json"
SEEDS, WORKERS = (0, 1, 2), 2


def main() -> None:
    """Train, shoot, judge."""
    keep_compiled()
    command, setting = Reproduce(), load_setting(SettingFiles())
    how: dict[str, Any] = {"trainer": "gradient", "gradient": command.gradient}
    tasks = {
        (limit, seed): TrainingTask(setting, 0.5, "history", DEFAULT_FRAMES, limit, command.ppo, seed, **how)
        for limit in COMMAND_LIMITS
        for seed in SEEDS
    }
    trainings: list[Task] = [(run_task, task, float(task.decisions)) for task in tasks.values()]
    trained = dict(zip(tasks, run_tasks("training", "decisions", trainings, WORKERS), strict=True))
    rows: list[dict[str, Any]] = []
    for limit in COMMAND_LIMITS:
        place = EvaluationTask(setting, limit, command.engagements, command.seed)
        policies = tuple(trained[limit, seed].policy for seed in SEEDS)
        evaluation = EvaluationTask(**{**vars(place), "controllers": AGAINST, "policies": policies})
        ground, shot = make_ground(place), run_evaluation(evaluation)
        pairs = [each for name in AGAINST for each in comparisons(ground, shot, name)]
        rows += places(pairs, cells(ground, shot, run_bounds(place)), ground.setting, limit)
    show(rows)
    conditions: dict[str, Any] = {"engagements_per_cell": command.engagements, "decisions": command.gradient.steps}
    conditions |= provenance(command.seed)
    storage.write_json(RESULT, {"machine": describe_machine(), "conditions": conditions, "trainings": rows})
    sys.exit(any(row["missed"] for row in rows))


if __name__ == "__main__":
    main()
