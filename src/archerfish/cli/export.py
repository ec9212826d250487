"""`archerfish export`: a policy as one file that runs without us."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from rich.console import Console

from archerfish.cli.interrupts import without_interrupts
from archerfish.cli.options import JsonFile, Switch
from archerfish.cli.outputs import Outputs
from archerfish.cli.progress import note
from archerfish.deployment.export import export_policy
from archerfish.deployment.onnx_model import OPSET
from archerfish.records import storage
from archerfish.records.errors import file_error


@dataclass(frozen=True)
class Export:
    """Write a policy as an ONNX file that runs without Archerfish.

    One run of the file is one decision: what the robot sees goes in as it is, pitch and yaw come out. Filters, aim,
    normalisation and clips are inside; what the policy remembers goes in and out as one array. Its metadata tell units,
    frame, inputs, decision period and the hash of the policy's record. Needs the extra export.

    Examples:
      archerfish export runs/train
      archerfish export runs/train/policy.json --format onnx --out infantry.onnx
    """

    policy: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RUN|POLICY")]
    """Run folder of train, or policy record (policy.json; its arrays lie beside it)."""
    format: Literal["onnx"] = "onnx"
    """Format of the file."""
    out: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE.onnx", help_behavior_hint="(default: the policy's name, ending in .onnx)"),
    ] = None
    """File to write."""
    check: Switch = True
    """Leave out the comparison of the file, run by ONNX Runtime where that is installed, with the policy."""
    seed: int = 0
    """Not used; nothing is random."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write the metadata to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        return Outputs(named=(self.out or _policy_file(self).with_suffix(".onnx"),))


def run_export(command: Export) -> dict[str, Any]:
    """Write the file, print how to call it, and return what --json writes.

    Raises:
      InputError: if the policy can't be used, the file can't be written, or onnx is missing.
    """
    policy = _policy_file(command)
    if not policy.is_file() and policy != command.policy:
        raise file_error(command.policy, "is a folder without policy.json", "name a run folder of archerfish train")
    (out,) = command.outputs().named
    with without_interrupts():
        storage.check_writable(out.parent)
    facts = export_policy(policy, out, command.check)
    console = Console(highlight=False, soft_wrap=True)
    kind, period = facts["observation"]["kind"], facts["decision_period_s"]
    console.print(
        f"{out}: {kind} policy, opset {OPSET}, {facts['bytes'] / 1024:.0f} KiB, a decision every {1e3 * period:g} ms"
    )
    for name, told in facts["inputs"].items():
        shape = ", ".join(map(str, told["shape"]))
        unit = f" [{told['unit']}]" if told["unit"] else ""
        console.print(f"  {name:<11} ({shape}) {told['meaning']}{unit}", markup=False)
    others = ", ".join(name for name in facts["outputs"] if name != "angle_command")
    console.print(f"  → angle_command (batch, 2) pitch and yaw before all limits [rad], {others}", markup=False)
    if facts["checked_rad"] is not None:
        console.print(f"checked: ONNX Runtime commands the same as NumPy, to {1e6 * facts['checked_rad']:.2g} µrad")
    elif command.check:
        note("the file was not run, since onnxruntime is not installed; pip install 'archerfish[export]'")
    return {"file": str(out), **facts}


def _policy_file(command: Export) -> Path:
    return command.policy / "policy.json" if command.policy.is_dir() else command.policy
