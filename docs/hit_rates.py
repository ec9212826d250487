"""Draw hit_rates.svg and store its figures, those of README's table, from the results of `archerfish reproduce`.

`python docs/hit_rates.py runs/reproduce/results.json` after `archerfish reproduce`, whose seed is 0. Writes
benchmarks/results/readme.json.
"""

import json
import sys
from pathlib import Path

from archerfish.evaluation.plots import hit_rates
from archerfish.reports.style import plot_style
from archerfish.studies.study import Study

ROOT = Path(__file__).parents[1]
NAMES = ("policy", "kalman", "kalman-lq", "imm-lq", "oracle")
TITLES = {"static": "targets at rest", "dynamic": "moving targets"}


def cells_of(study):
    """Return the cells of the virtual robot, by controller."""
    cells = [cell for cell in study.results.cells if cell.world == "virtual infantry" and cell.controller in NAMES]
    return sorted(cells, key=lambda cell: NAMES.index(cell.controller))


def rows(cells):
    """Return a row per cell: controller, targets, range [m], hits, decisions, rate and its 95 % interval [%]."""
    listed = []
    for cell in cells:
        place = {"controller": cell.controller, "targets": cell.motion, "range_m": list(cell.range_m)}
        percent = {
            name: round(value, 1) for name, value in zip(("rate", "low", "high"), cell.estimate[:3], strict=True)
        }
        listed.append(place | {"hits": cell.hits, "decisions": cell.decisions} | percent)
    return listed


if __name__ == "__main__":
    found = cells_of(Study.load(Path(sys.argv[1])))
    figure = hit_rates(found, names=NAMES)
    for panel, title in zip(figure.axes, TITLES.values(), strict=True):
        panel.set_title(title, loc="left")
    figure.axes[0].set_ylim(70.0, 95.0)
    with plot_style():  # which makes the same bytes on every run
        figure.savefig(Path(__file__).with_suffix(".svg"), metadata={"Date": None})
    stored = {"command": "archerfish reproduce", "seed": 0, "world": "virtual infantry", "percent": rows(found)}
    (ROOT / "benchmarks" / "results" / "readme.json").write_text(json.dumps(stored, indent=1) + "\n")
