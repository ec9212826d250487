"""`export`: any controller as a C file, or as an ONNX model, that decides as it does here."""

from __future__ import annotations  # so that help() names the types, rather than what they stand for

from pathlib import Path
from typing import Any

from archerfish.codegen.c99 import print_c
from archerfish.codegen.check import DIFFERENCE, SHARE, compared, onnx_decision
from archerfish.codegen.decision import EXAMPLES, UNTRACEABLE, Gated, example_decisions, trace_decision
from archerfish.codegen.library import MARK, compiled, contract
from archerfish.codegen.onnx import print_onnx
from archerfish.controllers.policy.policy import Policy
from archerfish.controllers.registry import ControllerLike, load_controller, make_controller
from archerfish.controllers.tuning import TuningLike
from archerfish.errors import InputError, checked_arguments, file_error
from archerfish.evaluation.contenders import as_contenders
from archerfish.evaluation.tuning_search import settings
from archerfish.reports.report import Report
from archerfish.reports.table import Table
from archerfish.robot import Robot, RobotLike
from archerfish.safety.rules import gate_rules
from archerfish.storage import check_regular, write_bytes
from archerfish.task import Task, TaskLike

MOST = 1.0
"""Share of the decisions that may differ by more than rounding, where a choice between hypotheses turns [%]."""
C_HEADERS = """assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg
stdatomic stdbool stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype"""
"""Headers of C11, whose names a compiler may look for among the caller's files first."""
UNCHECKED = "To compare it, install a C compiler or ONNX Runtime; a C file's self-test does the same on the robot."


@checked_arguments
def export(
    controller: ControllerLike,
    path: str | Path,
    robot: RobotLike = None,
    task: TaskLike = "any",
    *,
    tuning: TuningLike = "kept",
) -> Report:
    """Write a controller as a C file with its header, or as an ONNX model, and compare it with NumPy.

    It takes what is seen of one plate, on a base that may turn but not drive, and gives a command within the robot's
    limits; docs/export.md has the interface.

    Args:
      controller: a policy, or the file or folder of one; or a name, as `kalman`, `kalman-lq` or `imm-lq`; or a
        compiled controller of one's own, whose formulas can be traced.
      path: ends with .c or .onnx; a file in its place is replaced if this made it.
      robot: for whose plant and limits: a robot or its folder; the paper's if not given.
      task: decision period and command limit: a task, its name or its file; a policy has those of its own.
      tuning: of a controller with a name: "kept", what `tune` or `evaluate` has kept, searched for in a few minutes if
        there is nothing; "start", as before tuning; or settings, or a mapping from names to settings.

    Returns:
      What was written, how near it is to NumPy, and what was not checked.

    Raises:
      InputError: if the controller can't be exported for this robot, or a file can't be written.
    """
    path = Path(path)
    if path.suffix not in (".c", ".onnx") or not path.name.isprintable() or '"' in path.name:
        raise InputError(f"{path}: expected a name that ends with .c or .onnx and has no quotes; choose such a name")
    if path.suffix == ".c" and path.stem.lower() in C_HEADERS.split():
        hidden = f"{path.with_suffix('.h').name} would hide the C library's {path.stem.lower()}.h"
        raise InputError(f"{path}: {hidden}; name another file")
    targets = [path, path.with_suffix(".h")] if path.suffix == ".c" else [path]
    for target in targets:
        check_regular(target)
        if target.exists() and MARK.encode() not in target.read_bytes():
            raise file_error(target, "was not written by export", "name another file, or remove it")
    robot = Robot.of(robot)
    name, made, task = for_robot(controller, robot, Task.of(task), tuning)
    gated = Gated(made, gate_rules(robot, task))
    try:
        decision = trace_decision(gated)
    except UNTRACEABLE as error:
        raise InputError(f"{name} can't be exported: {error}; see docs/export.md") from error
    settled = "before tuning" if tuning == "start" and not isinstance(made, Policy) else f"for the task {task.name}"
    title = f"{name}: a decision every {1e3 * task.period_s:g} ms for the robot {robot.name}, "
    content = contract(f"{title}settings {settled}, limit {task.command_limit}", gated, robot, task)
    if path.suffix == ".c":
        files = print_c(decision, content, path, list(example_decisions(gated, EXAMPLES)))
        library = compiled(files)
        checked = compared(library.decide if library else None, gated)
    else:
        files = {path: print_onnx(decision, content)}
        checked = compared(onnx_decision(files[path]), gated)
    if not checked.get(SHARE, 0.0) <= MOST:
        raise InputError(f"{path}: differs by {checked[DIFFERENCE]:.2g} rad from NumPy; nothing is written, report it")
    new = [file for file in files if not file.exists()]
    try:
        for file, text in files.items():
            write_bytes(file, text)
    except InputError:  # a disk is full: half of two files is of no use
        for file in new:
            file.unlink(missing_ok=True)
        raise
    sizes = {f"{each.name} [KiB]": round(len(text) / 1024) for each, text in files.items()}
    tables = (Table("The file", ("", "figure"), tuple((sizes | checked).items())),)
    found = f"decides as {name} does in NumPy" if checked else "is written, but was not compared with NumPy"
    steps = () if checked else (UNCHECKED,)
    return Report(f"Export of {name}", f"{path.name} {found}.", next_steps=steps, tables=tables)


def for_robot(controller: ControllerLike, robot: Robot, task: Task, tuning: TuningLike) -> tuple[str, Any, Task]:
    """Return name and controller for a robot, and the task: that of the training of a policy.

    Args:
      controller: as `export` takes it.
      robot: for whose plant and limits.
      task: decision period and command limit.
      tuning: as `export` takes it.

    Raises:
      InputError: if no robot can run it, or a policy was trained for another one.
    """
    controller = load_controller(controller)
    facts = controller.facts if isinstance(controller, Policy) else None
    task = facts.task if facts else task
    if task.command_limit == "los-2deg":
        raise InputError("los-2deg limits commands by where the target really is, as no robot knows; take gate or box")
    if facts and facts.robot != robot.record_digests():
        raise InputError(f"the policy was trained in other records than {robot.name}'s; name its folder, or train")
    if facts:
        return "policy", controller, task
    name = controller if isinstance(controller, str) else ""
    if name == "oracle":
        raise InputError("oracle knows the target's path, as no robot does; name another controller")
    [contender] = as_contenders({name or type(controller).__name__: controller})
    tunings = settings([contender], tuning, robot, task)
    made = make_controller(controller, robot, task, tunings.get(contender.name))
    return name or type(made).__name__, made, task
