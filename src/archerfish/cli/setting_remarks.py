"""What a person should know of the files that a command was given: what they leave to stand-ins, and what differs."""

from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

from archerfish.cli.setting import Setting, SettingFiles, both_axes, plant_code, recorded_files
from archerfish.plugins import options_to_type
from archerfish.records.policy import PolicyRecord
from archerfish.records.storage import file_hash

_STAND_INS = {
    "pitch": ("the paper's plants (--pitch, --yaw)"),
    "muzzle": ("the assumed muzzle (--muzzle)"),
    "limits": ("the paper's limits (--limits)"),
}


def setting_remarks(files: SettingFiles, setting: Setting) -> Iterator[str]:
    """Say what stands in for files that were not given beside others, and what a sensing record leaves open.

    Args:
      files: as given.
      setting: what they were resolved to.
    """
    files = both_axes(files)
    lacking = [told for name, told in _STAND_INS.items() if getattr(files, name) is None]
    if setting.inputs and lacking:
        yield f"{setting.name} is not all of your robot: it has {_joined(lacking)}"
    if setting.sensing is not None and setting.sensing.link.command_latency is None:
        yield (
            f"{files.sensing}: the command latency is not known, so commands are sent without any; give identify "
            "sensing --commands and --feedback, unless the plants' logs hold it already"
        )


def policy_remarks(path: Path, policy: PolicyRecord, setting: Setting) -> Iterator[str]:
    """Say if a policy was trained with other files than those that it is evaluated with.

    Args:
      path: of the policy, for the message.
      policy: its record.
      setting: that of the evaluation.
    """
    inputs: Any = policy.provenance.get("inputs")
    # Without inputs in its record, a policy is of unknown making; one of a rehearsal was made from logs, not from
    # records or code.
    if not isinstance(inputs, dict) or any(not str(name).endswith((".json", ".py")) for name in inputs):
        return
    trained = {str(digest): str(name) for name, digest in inputs.items()}
    given = {file_hash(each): str(each) for each in setting.inputs}
    only_here = [name for digest, name in given.items() if digest not in trained]
    only_there = [name for digest, name in trained.items() if digest not in given]
    if not only_here and not only_there:
        return
    here = f"not with {_joined(only_here)}" if only_here else ""
    there = f"with {_joined(only_there)}, which the evaluation has not" if only_there else ""
    if not inputs:
        there = "for the paper's gimbal"
    told = (
        f"{path}: was trained {' and '.join(filter(None, (there, here)))}; its hit rates are those of another setting"
    )
    files = recorded_files(path)
    options, first = _options(files), "read its code, then " if plant_code(files) else ""
    yield f"{told}; for the one it was trained for {first}add {options}" if options else told


def _options(files: SettingFiles) -> str:
    """Return what to type for the files of a robot; nothing where none is given."""
    given = [(each.name, getattr(files, each.name)) for each in fields(files)]
    return options_to_type({f"--{name}": str(value) for name, value in given if value and not isinstance(value, bool)})


def _joined(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), words[-1])))
