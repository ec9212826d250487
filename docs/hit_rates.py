"""Draw hit_rates.svg, and print the table of README, from what `archerfish reproduce` has stored.

`python docs/hit_rates.py runs/reproduce/results.json` after `archerfish reproduce`, whose seed is 0.
"""

import sys
from pathlib import Path

from archerfish.evaluation.plots import hit_rates
from archerfish.studies.study import Study

NAMES = ("policy", "kalman", "kalman-lq", "imm-lq", "oracle")
TITLES = {"static": "targets at rest", "dynamic": "moving targets"}


def cells_of(study):
    """Return the cells of the virtual robot, by controller."""
    cells = [cell for cell in study.results.cells if cell.world == "virtual infantry" and cell.controller in NAMES]
    return sorted(cells, key=lambda cell: NAMES.index(cell.controller))


def rows(cells):
    """Return the rows of the table: targets and range, then each controller's rate with its interval."""
    lines = [f"| targets | {' | '.join(f'`{name}`' for name in NAMES)} |", "|---" * (1 + len(NAMES)) + "|"]
    for motion, title in TITLES.items():
        for low, high in sorted({cell.range_m for cell in cells}):
            shown = [cell for cell in cells if cell.motion == motion and cell.range_m == (low, high)]
            rates = [f"{100 * cell.rate:.1f} ({100 * cell.low:.1f}–{100 * cell.high:.1f})" for cell in shown]
            lines.append(f"| {title}, {low:g}–{high:g} m | {' | '.join(rates)} |")
    return lines


if __name__ == "__main__":
    found = cells_of(Study.load(Path(sys.argv[1])))
    figure = hit_rates(found, names=NAMES)
    for panel, title in zip(figure.axes, TITLES.values(), strict=True):
        panel.set_title(title, loc="left")
    figure.axes[0].set_ylim(70.0, 95.0)
    figure.savefig(Path(__file__).with_suffix(".svg"))
    sys.stdout.write("\n".join(rows(found)) + "\n")
