"""Evaluations as whole processes, from a cold start with kept programs, in seconds.

`python benchmarks/cold_evaluation.py [--against REVISION]`: one controller in the paper's task, 100 engagements a
cell. `--work` also has five controllers on tests/infantry with kept tuning ("infantry, tuned") and with their tuning
("infantry"), a minute each. The machine should do nothing else. Writes results/cold_evaluation.json.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import alternating

FIVE = ("kalman", "kalman-lq", "imm-lq", "parabola-lq", "oracle")
PAPER = 'import archerfish as af; af.evaluate(["kalman"], task="paper", engagements=100)'
INFANTRY = f'import archerfish as af; af.evaluate({FIVE!r}, "ROBOT", "paper", engagements=100)'
NAMES = ("paper", "infantry, tuned", "infantry")


def prepare() -> alternating.Work:
    """Return name → an evaluation in a process of its own, with programs that are kept between them."""
    folder = tempfile.TemporaryDirectory()
    robot = Path(folder.name) / "infantry"
    robot.mkdir()
    for source in (alternating.ROOT / "tests" / "infantry").glob("*.json"):
        if source.name != "tuning.json":
            (robot / source.name).write_bytes(source.read_bytes())

    def evaluate(code: str) -> int:
        environment = {**os.environ, "ARCHERFISH_CACHE": f"{folder.name}/cache"}
        words = [sys.executable, "-c", code.replace("ROBOT", str(robot))]
        subprocess.run(words, env=environment, capture_output=True, check=True)
        return 1

    def tune_and_evaluate() -> int:
        (robot / "tuning.json").unlink(missing_ok=True)
        return evaluate(INFANTRY)

    return dict(zip(NAMES, (lambda: evaluate(PAPER), lambda: evaluate(INFANTRY), tune_and_evaluate), strict=True))


if __name__ == "__main__":
    alternating.run(__doc__, __file__, prepare, NAMES, pairs=5, usual=NAMES[:1], in_seconds=True)
