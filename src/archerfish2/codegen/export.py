"""`export`: any controller as a C file, or as an ONNX model, that decides as it does here."""

import tempfile
from pathlib import Path
from typing import Any, Literal

from archerfish2.codegen.c99 import print_c
from archerfish2.codegen.check import DIFFERENCE, SHARE, c_decision, compared, onnx_decision
from archerfish2.codegen.decision import Gated, example_decisions, trace_decision
from archerfish2.codegen.onnx import print_onnx
from archerfish2.controllers.policy.policy import Policy
from archerfish2.controllers.registry import is_policy, make_controller
from archerfish2.controllers.tuning import GRIDS, Tuning, kept
from archerfish2.errors import InputError, file_error
from archerfish2.provenance import code_commit
from archerfish2.reports.report import Report
from archerfish2.reports.table import Table
from archerfish2.robot import Robot
from archerfish2.storage import check_regular, write_bytes
from archerfish2.task import Task

MARK = "Made by Archerfish"
"""In every file that this writes: what has it may be replaced."""
MOST = 1.0
"""Share of the decisions that may differ by more than rounding, where a choice between hypotheses turns [%]."""
EXAMPLES = 24  # decisions of the self-test
UNCHECKED = "To compare it, install a C compiler or ONNX Runtime; a C file's self-test does the same on the robot."


def export(
    controller: Policy | str | Any,
    path: str | Path,
    robot: Robot | str | Path | None = None,
    task: Task | str = "any",
    tuning: Tuning | Literal["start"] | None = None,
) -> Report:
    """Write a controller as a C file with its header, or as an ONNX model, and compare it with NumPy.

    It takes what is seen of one plate, on a base that may turn but not drive, and gives a command within the robot's
    limits; docs2/export.md has the interface.

    Args:
      controller: a policy, or the file or folder of one; or a name, as `kalman`, `kalman-lq` or `imm-lq`; or a
        compiled controller of one's own, whose formulas can be traced.
      path: ends with .c or .onnx; a file in its place is replaced if this made it.
      robot: for whose plant and limits; not given, the paper's, or that a policy was trained for if it is the paper's.
      task: decision period and command limit; a policy has those of its own.
      tuning: of a controller with a name; not given, what `tune` or `evaluate` has kept; "start": as before tuning.

    Returns:
      What was written, how near it is to NumPy, and what was not checked.

    Raises:
      InputError: if the controller can't be exported for this robot, or a file can't be written.
    """
    path = Path(path)
    if path.suffix not in (".c", ".onnx") or not path.name.isprintable() or '"' in path.name:
        raise InputError(f"{path}: expected a name that ends with .c or .onnx, without quotes; choose such a name")
    robot = Robot.of(robot)
    name, made, task = _controller(controller, robot, task, tuning)
    if task.command_limit == "los-2deg":
        raise InputError("los-2deg limits commands by where the target really is, as no robot knows; take gate or box")
    gated = Gated(made, robot.command_limits(task), task.period_s)
    try:
        decision = trace_decision(gated)
    except (TypeError, ValueError, AttributeError, IndexError) as error:
        raise InputError(f"{name} can't be exported: {error}; see docs2/export.md") from error
    facts = {
        "title": f"{name}: a decision every {1e3 * task.period_s:g} ms for the robot {robot.name}",
        "made": f"{MARK} {code_commit()[:12]}; do not edit.",
        "period_s": task.period_s,
        "limits": [float(each[axis]) for axis in range(2) for each in gated.limits[:4]],
        "robot": robot.digest(),
    }
    if path.suffix == ".c":
        files = print_c(decision, facts, path, list(example_decisions(gated, EXAMPLES)))
        with tempfile.TemporaryDirectory() as folder:
            for each, text in files.items():
                write_bytes(Path(folder, each.name), text)
            checked = compared(c_decision(Path(folder, path.name), len(decision.memory)), gated)
    else:
        files = {path: print_onnx(decision, facts)}
        checked = compared(onnx_decision(files[path]), gated)
    if not checked.get(SHARE, 0.0) <= MOST:
        raise InputError(f"{path}: differs by {checked[DIFFERENCE]:.2g} rad from NumPy; nothing is written, report it")
    for each in files:
        check_regular(each)
        if each.exists() and MARK.encode() not in each.read_bytes():
            raise file_error(each, "was not written by export", "name another file, or remove it")
    for each, content in files.items():
        write_bytes(each, content)
    sizes = {f"{each.name} [KiB]": round(len(content) / 1024) for each, content in files.items()}
    tables = (Table("The file", ("", "figure"), tuple((sizes | checked).items())),)
    found = f"decides as {name} does in NumPy" if checked else "is written, but was not compared with NumPy"
    steps = () if checked else (UNCHECKED,)
    return Report(f"Export of {name}", f"{path.name} {found}.", next_steps=steps, tables=tables)


def _controller(
    given: Any, robot: Robot, task: Task | str, tuning: Tuning | Literal["start"] | None
) -> tuple[str, Any, Task]:
    """Return a name, the controller and its task."""
    given = Policy.load(given) if is_policy(given) else given
    if isinstance(given, Policy) and given.facts is not None:
        if given.facts.robot != robot.record_digests():
            raise InputError(f"the policy was trained in other records than {robot.name}'s; name its folder, or train")
        return "policy", given, given.facts.task
    task, name = Task.of(task), given if isinstance(given, str) else ""
    if name == "oracle":
        raise InputError("oracle knows the target's path, as no robot does; export another controller")
    if name not in GRIDS or tuning == "start":
        tuning = None
    elif tuning is None and (tuning := kept(name, robot, task)) is None:
        remedy = f'call archerfish2.tune("{name}", robot, task)'
        if robot.folder or robot.digest() == Robot.paper().digest():
            limit = "" if task.command_limit == "gate" else f" --command-limit {task.command_limit}"
            is_usual = task.replace(command_limit="gate", name="") == Task(motion=task.motion)
            words = f"--task {task.motion if is_usual else 'FILE'}{limit} --controllers {name}"
            remedy = f"run archerfish2 evaluate {f'{robot.folder} ' if robot.folder else ''}{words}"
        untuned = 'take it as it is before tuning: --untuned, tuning="start"'
        raise InputError(f"{name} is not tuned for {robot.name} and this task; {remedy}, or {untuned}")
    made = make_controller(given, robot, task, tuning)
    return name or type(made).__name__, made, task
