"""Tune the classical controllers in the simulator of the printed gimbal, on draws that no evaluation uses.

    python benchmarks/tuning.py

Writes src/archerfish/paper/tuning.json, which every evaluation in that simulator takes its settings from, and every
setting that was tried to benchmarks/results/tuning.json.
"""

from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.evaluation_run import EvaluationTask, tune_controllers, tuned_rate, tuning_ground
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.controllers.roster import Tuning
from archerfish.evaluation.tuning import GRIDS, Neighbours, Tuned
from archerfish.paper import tuning as paper_tuning
from archerfish.records import storage
from archerfish.records.provenance import provenance
from machine import describe_machine

RESULT = Path(__file__).parent / "results" / "tuning.json"
SETTINGS = Path(paper_tuning.__file__).with_name("tuning.json")
SEED, ENGAGEMENTS, PROBE = 0, 200, 4
CONTROLLERS = ("kalman-tuned", "kalman-lq", "imm-lq", "parabola-lq")
LIMITS = ("gate", "box", "los-2deg")


def main() -> None:
    """Tune every controller under every command limit."""
    keep_compiled()
    setting, stored, trials = load_setting(SettingFiles()), [], []
    for limit in LIMITS:
        task = EvaluationTask(setting, limit, 2, SEED, CONTROLLERS)
        probe = tuning_ground(task, PROBE)
        for tuned in tune_controllers(task, engagements=ENGAGEMENTS):
            rate = tuned_rate(task, probe, tuned.controller, tuned.tuning)
            stored.append({"command_limit": limit, **_settings(tuned), "probe_hit_rate": round(rate, 6)})
            trials += [
                {"command_limit": limit, "controller": tuned.controller, **_values(tuned, tuning), "hit_rate": rate}
                for tuning, rate in tuned.tried
            ]
    facts = {"stream": "tuning", "engagements": ENGAGEMENTS, "probe_engagements": PROBE}
    storage.write_json(SETTINGS, {**facts, "controllers": stored, "provenance": provenance(SEED)})
    storage.write_json(RESULT, {"machine": describe_machine(), "conditions": {"seed": SEED, **facts}, "trials": trials})
    _show(stored)


def _settings(tuned: Tuned) -> dict[str, Any]:
    return {
        "controller": tuned.controller,
        "settings": _values(tuned, tuned.tuning),
        "neighbours": {name: _sides(each) for name, each in tuned.neighbours.items()},
        "hit_rate": tuned.hit_rate,
        "tried": len(tuned.tried),
    }


def _values(tuned: Tuned, tuning: Tuning) -> dict[str, float]:
    # The first setting of a controller without a process noise is none of its own.
    return {name: getattr(tuning, name) for name in ("acceleration_sd", *GRIDS[tuned.controller])}


def _sides(neighbours: Neighbours) -> dict[str, dict[str, float] | None]:
    sides = {"below": neighbours.below, "above": neighbours.above}
    return {side: None if each is None else {"value": each[0], "hit_rate": each[1]} for side, each in sides.items()}


def _show(stored: list[dict[str, Any]]) -> None:
    table = Table("limit", "controller", "%", "tried", "settings (neighbours, points less)", title="tuned")
    for each in stored:
        words = [f"{name} {each['settings'][name]:g} ({_beside(each, name)})" for name in each["neighbours"]]
        rate = f"{100 * each['hit_rate']:.2f}"
        table.add_row(each["command_limit"], each["controller"], rate, str(each["tried"]), "\n".join(words))
    Console(width=140).print(table)


def _beside(stored: dict[str, Any], name: str) -> str:
    return ", ".join(
        "bound" if side is None else f"{side['value']:g}: {100 * (stored['hit_rate'] - side['hit_rate']):.2f}"
        for side in stored["neighbours"][name].values()
    )


if __name__ == "__main__":
    main()
