"""Through how many files a log passes, from a CSV to the result of `identify_axis` and to its page; and a verb.

The verbs are an evaluation of one classical controller in one cell, one decision of it, and a short training.

`python benchmarks/files_entered.py` counts the files of the package whose functions are called, by `sys.setprofile`,
and the changes from one file to another, and writes results/files_entered.json.
"""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

import archerfish
from archerfish.controllers.registry import make_controller
from archerfish.evaluation.evaluate import evaluate
from archerfish.identification.axis.identify import AxisResult, identify_axis
from archerfish.identification.simulation import simulate
from archerfish.learning.config import GradientConfig, TrainConfig
from archerfish.learning.train import train
from archerfish.logs.log import read_log
from archerfish.logs.recording import Recording
from archerfish.protocols import seen_ahead
from archerfish.records.plant import PlantRecord
from archerfish.reports.table import Table
from archerfish.robot import Robot
from archerfish.task import Task
from bars import Bar, finish

PACKAGE = Path(archerfish.__file__).parent
PERIOD_S = 0.005
IDENTIFYING, PAGE, EVALUATING, DECIDING = 24, 29, 28, 10


class Entered:
    """The files whose functions are called while a profile is set."""

    def __init__(self) -> None:
        self.files: dict[str, int] = {}
        self.changes = 0
        self._last = ""

    def __call__(self, frame: FrameType, event: str, _: Any) -> None:
        """Count a call into another file of the package."""
        if event != "call" or not frame.f_code.co_filename.startswith(str(PACKAGE)):
            return
        file = str(Path(frame.f_code.co_filename).relative_to(PACKAGE))
        self.changes += file != self._last
        self.files[file] = self.files.get(file, 0) + 1
        self._last = file


def entered(action: Callable[[], Any]) -> Entered:
    """Run something and return the files that it entered."""
    found = Entered()
    sys.setprofile(found)
    try:
        action()
    finally:
        sys.setprofile(None)
    return found


def write_log(path: Path) -> None:
    """Write the log of an axis of second order."""
    plant = PlantRecord.second_order(5.0, 0.6, 0.02, PERIOD_S)
    u = np.random.default_rng(1).normal(size=40).repeat(50)[:, None]
    y = simulate(plant, u) + 0.01 * np.random.default_rng(2).normal(size=u.shape)
    Recording.from_arrays(u, y, PERIOD_S).write_csv(path)


def verbs(folder: str) -> dict[str, Entered]:
    """Count for an evaluation, a decision and a training; the second time, after what is loaded and kept once."""
    cell = Task(motion="dynamic", ranges_m=((2.0, 3.0),))
    controller, seen = make_controller("kalman", Robot.paper(), cell), seen_ahead(3)
    state = controller.reset(seen)
    config = TrainConfig(gradient=GradientConfig(environments=32, hidden=16, window=5, steps=640))
    actions: dict[str, Callable[[], Any]] = {
        "evaluate": lambda: evaluate("kalman", task=cell, engagements=4, tuning="start"),
        "decision": lambda: controller.step(state, seen),
        "train": lambda: train(task=cell, config=config, out=Path(folder, "policy")),
    }
    for action in actions.values():
        action()
    return {name: entered(action) for name, action in actions.items()}


def main() -> None:
    """Count, print and write; exit with 1 if a limit is missed."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "yaw.csv")
        write_log(path)
        results: list[AxisResult] = []
        identify_axis(path, axis="yaw").save(folder)  # what is imported when it is first used is loaded then
        reading = entered(lambda: read_log(path))
        identifying = entered(lambda: results.append(identify_axis(path, axis="yaw")))
        page = entered(lambda: results[0].save(folder))
        verb = verbs(folder)
    every = sorted({*identifying.files, *page.files})
    legs = {"read_log": reading, "identify_axis": identifying, "save": page, **verb}
    rows = [{"leg": leg, "files": len(found.files), "changes": found.changes} for leg, found in legs.items()]
    lines = tuple((leg, len(found.files), found.changes) for leg, found in legs.items())
    table = Table("files that a log enters", ("leg", "files", "changes of file"), lines, ", ".join(every))
    bars = [
        Bar("CSV to AxisResult, files", len(identifying.files), most=IDENTIFYING),
        Bar("CSV to page, files", len(every), most=PAGE),
        Bar("evaluate, files", len(verb["evaluate"].files), most=EVALUATING),
        Bar("decision, files", len(verb["decision"].files), most=DECIDING),
    ]
    finish("files_entered", bars, [table], {"period_s": PERIOD_S}, rows, True, files=every)


if __name__ == "__main__":
    main()
