"""`archerfish export`: a controller as a C file or an ONNX model."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from archerfish.cli.options import Ending, ForRobot, shown
from archerfish.controllers.registry import NAMES
from archerfish.errors import InputError
from archerfish.studies.export import export


@dataclass(frozen=True)
class Export(ForRobot):
    """Write a controller as a C file, or as an ONNX model, that decides as it does here.

    - NAME.c and NAME.h: C99 that calls nothing but math.h, allocates nothing and has no global state: a struct of what
      is seen in, a command within the robot's limits out; C++ includes the header. Or NAME.onnx
    - the file is compared with NumPy where a C compiler (or ONNX Runtime) is installed, and has a self-test inside
    - a policy is exported for the robot and the task that it was trained for; a classical controller is tuned for ROBOT
      and the task, in a few minutes, unless evaluate has done so

    Examples:
      archerfish export my-robot
      archerfish export my-robot --controller imm-lq --out imm_lq.c
      archerfish export --controller runs/train --out policy.onnx
    """

    controller: Annotated[str, shown("NAME|FOLDER")] = ""
    """A policy's file or folder, or kalman, kalman-lq, imm-lq, parabola-lq or no-lead; ROBOT/policy, or runs/train."""
    out: Annotated[Path | None, shown("FILE")] = None
    """What to write, NAME.c or NAME.onnx; policy.c, or the controller's name, in ROBOT, or here."""
    tuning: Annotated[Literal["kept", "start"], shown("kept|start", "(default: kept)")] = "kept"
    """Settings of a classical controller: those that are kept, which are searched for where there are none, or those
    where the search begins."""

    def run(self, _: str = "") -> Ending:
        """Export."""
        controller = self.controller or str(self.folder / "policy" if self.folder else Path("runs/train"))
        if not self.controller and not Path(controller).exists():
            raise InputError(f"{controller}: no such policy; train it, or name --controller")
        stem = controller.replace("-", "_") if controller in NAMES else "policy"
        out = self.out or (self.folder or Path()) / f"{stem}.c"
        robot, task = self.robot_and_task()
        report = export(controller, out, robot, task, tuning=self.tuning)
        written, step = f"{out}", "docs/export.md runs it in Python"
        if out.suffix == ".c":
            written, step = f"{out} and {out.with_suffix('.h')}", f"cc -O2 -ffp-contract=off -c {out}  # docs/export.md"
        return Ending(f"{report}", f"wrote {written}", step)
