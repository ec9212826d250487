"""Whether the way onto the robot is made for one robot only: the same command with robots that nothing was tuned on.

Each is the infantry with other inertia, friction, link, camera or muzzle. `archerfish transfer` with no other option
takes each from its logs to Tables IV and V; seeds 7, 8 and 9, which nothing was chosen on. Runs lie in
runs/other_robots/NAME, and one that is there already is not made again. Writes benchmarks/results/other_robots.json.
"""

import re
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from archerfish.cli.transfer import Transfer, run_transfer
from archerfish.evaluation.results import Results, read_results
from archerfish.records import storage
from archerfish.virtual_robot.description_file import robot_path
from machine import describe_machine
from policy_place import places, show

RESULT = Path(__file__).parent / "results" / "other_robots.json"
RUNS = Path("runs/other_robots")
SEEDS, ENGAGEMENTS = (7, 8, 9), 400
SLACK = 1.5
"""Points by which the bars of `policy_place` are lower for a robot that nothing was chosen on."""
Changes = dict[str, dict[str, float]]
"""Table of the description → key → value."""

ROBOTS: dict[str, Changes] = {
    "heavy": {
        "gimbal.yaw": {"armature_kg_m2": 0.008, "friction_n_m": 0.07},
        "gimbal.yaw_body": {"inertia_kg_m2": 0.010},
        "gimbal.pitch": {"friction_n_m": 0.06},
        "gimbal.pitch_body": {"mass_kg": 1.1, "pitch_inertia_kg_m2": 0.011, "yaw_inertia_kg_m2": 0.011},
        "firmware.yaw": {"rate_gain_n_m_s_per_rad": 1.5},
        "firmware.pitch": {"rate_gain_n_m_s_per_rad": 0.65},
        "link": {
            "command_rate_hz": 100,
            "command_latency_low_ms": 10,
            "command_latency_high_ms": 22,
            "feedback_rate_hz": 200,
            "feedback_angle_quantum_deg": 0.05,
        },
        "camera": {"rate_hz": 60, "latency_low_ms": 40, "latency_high_ms": 55, "clock_offset_ms": 12},
        "muzzle": {
            "speed_m_s": 22,
            "speed_sd_m_s": 0.35,
            "dispersion_pitch_deg": 0.25,
            "boresight_pitch_deg": -0.2,
            "boresight_yaw_deg": 0.3,
            "forward_m": 0.2,
        },
        "limits.yaw": {"max_acceleration_rad_per_s2": 40},
        "limits.pitch": {"max_acceleration_rad_per_s2": 70},
    },
    "late": {
        "link": {
            "command_latency_low_ms": 15,
            "command_latency_high_ms": 35,
            "feedback_rate_hz": 100,
            "feedback_latency_low_ms": 50,
            "feedback_latency_high_ms": 70,
        },
        "camera": {"rate_hz": 50, "latency_low_ms": 55, "latency_high_ms": 75},
        "muzzle": {"speed_m_s": 15, "speed_sd_m_s": 0.3},
    },
    "rough": {
        "gimbal.yaw": {"friction_n_m": 0.12},
        "gimbal.yaw_body": {"inertia_kg_m2": 0.008},
        "gimbal.pitch": {"friction_n_m": 0.1},
        "gimbal.pitch_body": {"mass_kg": 1.0, "forward_m": 0.04},
        "camera": {"lateral_sd_mm": 8, "range_sd_percent": 3, "miss_probability": 0.1},
        "muzzle": {
            "speed_m_s": 25,
            "dispersion_pitch_deg": 0.3,
            "dispersion_yaw_deg": 0.15,
            "boresight_yaw_deg": 0.5,
        },
    },
    "draggy": {"muzzle": {"drag_per_m": 0.024}},
}


def description(name: str, changes: Changes) -> str:
    """Return the infantry's description with other values."""
    text = robot_path("infantry").read_text().replace('name = "infantry"', f'name = "{name}"')
    for table, values in changes.items():
        begin = text.index(f"[{table}]\n")
        end = (text + "\n[").index("\n[", begin)
        body = text[begin:end]
        for key, value in values.items():
            body, found = re.subn(rf"^{key} = .*$", f"{key} = {value:g}", body, flags=re.MULTILINE)
            assert found == 1, (table, key)
        text = text[:begin] + body + text[end:]
    return text


def run_robot(name: str, engagements: int) -> Results:
    """Take a robot from its logs to the tables, or read what was made of it before."""
    folder = RUNS / name
    if not (folder / "results.json").exists():
        RUNS.mkdir(parents=True, exist_ok=True)
        file = RUNS / f"{name}.toml"
        file.write_text(description(name, ROBOTS[name]))
        run_transfer(Transfer(robot=str(file), changed=(), seeds=SEEDS, engagements=engagements, out=folder))
    return read_results(folder / "results.json")


def summary(name: str, results: Results) -> dict[str, Any]:
    """Judge a robot by the ends of paired 95 % intervals, in points."""

    def drop(controller: str, *, settled: bool) -> float:
        chosen = [each for each in results.drops if each.controller == controller and each.settled is settled]
        return round(100 * max(each.high for each in chosen), 2)

    policy = [each for each in results.cells if each.setting == name and each.controller == "history"]
    return {
        "robot": name,
        "commit": results.commit,
        "policy_percent": [round(100 * each.rate, 1) for each in policy],
        "above_paper_points": [round(100 * each.rate - each.paper, 1) for each in policy if each.paper is not None],
        "drop_settled_at_most": {each: drop(each, settled=True) for each in ("history", "kalman")},
        "drop_at_most": {each: drop(each, settled=False) for each in ("history", "kalman")},
        "places": [
            place
            for setting in (f"identified-{name}", name)
            for place in places(results.comparisons, results.cells, setting, "gate", SLACK)
        ],
    }


def main() -> None:
    """Run all robots; `--quick` with too little to be quoted, and without a file."""
    quick = "--quick" in sys.argv[1:]
    rows = [summary(name, run_robot(name, 4 if quick else ENGAGEMENTS)) for name in ROBOTS]
    table = Table("robot", "drop settled ≤", "drop whole ≤", "less paper ≥")
    for row in rows:
        drops = (" / ".join(map(str, row[name].values())) for name in ("drop_settled_at_most", "drop_at_most"))
        table.add_row(row["robot"], *drops, str(min(row["above_paper_points"])))
    Console(width=160).print(table)
    show([place for row in rows for place in row["places"]])
    if not quick:
        conditions = {**describe_machine(), "seeds": SEEDS, "engagements_per_cell": ENGAGEMENTS}
        storage.write_json(RESULT, {"conditions": conditions, "changes": ROBOTS, "robots": rows})
        sys.exit(any(place["missed"] for row in rows for place in row["places"]))


if __name__ == "__main__":
    main()
