"""A policy as one file that runs without us: raw frames in, angles out, and what one must know to use it."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from archerfish import __version__
from archerfish.controllers.guarded_policy import GuardedPolicy, controller_from_record
from archerfish.controllers.network import OBSERVATION_CLIP
from archerfish.controllers.policy import PolicyController
from archerfish.deployment.decision_graph import FRAME_SHAPES, DecisionGraph, decision_graph
from archerfish.deployment.observation_layout import observation_layout
from archerfish.deployment.onnx_check import can_check, largest_difference
from archerfish.deployment.onnx_model import onnx_model
from archerfish.deployment.symbol import in_order
from archerfish.records import storage
from archerfish.records.errors import file_error
from archerfish.records.policy import PolicyRecord, read_policy

FORMAT = "archerfish.policy.onnx/1"
UNITS = "SI: m, s, rad, m/s, rad/s"
FRAME = (
    "x forward, y left, z up, right-handed, origin at the gimbal's pivot, axes of the base; "
    "yaw positive to the left, pitch positive with the muzzle up"
)
_ABOUT = """\
An Archerfish policy. One run is one decision: state and frame in, next_state and angle_command out. Feed next_state
back as state; at the first decision of an engagement first is true, and the state may be anything. The command is what
the policy wants: the limits of the gimbal are kept by whoever runs it. Where a NaN goes in, NaN comes out, until it is
forgotten or the next engagement begins. The metadata tell the rest."""
TOLERANCE_RAD = 1e-3
"""Far beyond rounding, which a policy may magnify to a tenth of it, and far below what a shot would notice."""
_MEANINGS = {
    "elapsed": ("s", "since the last decision; 0 at the first"),
    "angle": ("rad", "pitch and yaw of the gimbal, latest feedback"),
    "gimbal_age": ("s", "since that feedback was sampled"),
    "command": ("rad", "pitch and yaw command in force, after all limits"),
    "plate": ("m", "armor plate as seen last: x, y, z"),
    "plate_age": ("s", "since the exposure that shows it"),
    "fresh": ("", "whether it was exposed anew since the last decision; at the first, whether a frame shows it at all"),
    "first": ("", "whether this is the first decision of an engagement"),
    "state": ("", "next_state of the decision before; not looked at where first is true"),
}
"""Input → unit and meaning."""


def export_policy(path: Path, out: Path, check: bool = True) -> dict[str, Any]:
    """Write a policy as an ONNX file, whole or not at all.

    Args:
      path: the policy record, JSON.
      out: the file to write; it must end in .onnx.
      check: whether ONNX Runtime, where it is installed, must first decide as the policy does.

    Returns:
      The metadata, `bytes`, and `checked_rad`: the largest difference that the check met, None where there was none.

    Raises:
      InputError: if the record can't be used, `out` is no name for it or can't be written, onnx is missing, or the file
        would decide otherwise than the policy.
    """
    if out.suffix != ".onnx":
        raise file_error(out, "is to hold an ONNX model, but does not end in .onnx", "give a name that does")
    record = read_policy(path)
    controller = controller_from_record(record)
    graph = decision_graph(controller)
    facts = _facts(record, controller, graph) | {
        "record_sha256": storage.file_hash(path),
        "arrays_sha256": storage.file_hash(path.with_suffix(".safetensors")),
    }
    outputs = {"angle_command": graph.angle, "next_state": graph.next_state}
    if graph.fallback is not None:
        outputs["fallback"] = graph.fallback
    content = onnx_model(outputs, _texts(facts), __version__, _ABOUT)
    apart = largest_difference(controller, content, record.period_s) if check and can_check() else None
    if apart is not None and not np.isfinite(apart):
        raise file_error(
            out,
            "would command what is no finite number where a robot sees ordinary targets, expected angles",
            "nothing is written; train the policy anew, or look at its record",
        )
    if apart is not None and not apart <= TOLERANCE_RAD:
        raise file_error(
            out,
            f"would command up to {apart:.2g} rad otherwise than the policy, expected {TOLERANCE_RAD:g} or less",
            "nothing is written; another version of onnxruntime may do, --no-check leaves the comparison out",
        )
    storage.write_bytes(out, content)
    return {**facts, "bytes": len(content), "checked_rad": apart}


def _facts(record: PolicyRecord, controller: PolicyController | GuardedPolicy, graph: DecisionGraph) -> dict[str, Any]:
    outputs: dict[str, Any] = {
        "angle_command": {"shape": ["batch", 2], "unit": "rad", "meaning": "pitch and yaw, before all limits"},
        "next_state": {"shape": list(graph.next_state.shape), "unit": "", "meaning": "state of the next decision"},
    }
    if graph.fallback is not None:
        meaning = "whether a Kalman filter, which predicted the target better of late, has more than half of the aim"
        outputs["fallback"] = {"shape": ["batch"], "unit": "", "meaning": meaning}
    return {
        "format": FORMAT,
        "archerfish_version": __version__,
        "units": UNITS,
        "frame": FRAME,
        "decision_period_s": record.period_s,
        "inputs": _inputs(graph),
        "outputs": outputs,
        "state": [{"name": part.name, "shape": list(part.shape)} for part in graph.state_parts],
        "observation": {
            "kind": record.observation,
            "size": controller.observer.size,
            "layout": observation_layout(controller.observer),
            "clipped_at_standard_deviations": OBSERVATION_CLIP,
        },
        "command_limits": {
            "trained_under": record.command_limit,
            "largest_change_of_move_per_decision_rad": np.asarray(record.braking, float).tolist(),
        },
        "muzzle": record.muzzle,
        "tracker": record.tracker,
        "training": record.training,
        "provenance": record.provenance,
    }


def _inputs(graph: DecisionGraph) -> dict[str, dict[str, Any]]:
    """Describe the inputs that the policy uses."""
    taken = [each for each in in_order([graph.angle, graph.next_state]) if not each.operation]
    names = [*FRAME_SHAPES._fields, "first", "state"]
    return {
        each.name: {
            "shape": list(each.shape),
            "type": each.dtype.name,
            "unit": _MEANINGS[each.name][0],
            "meaning": _MEANINGS[each.name][1],
        }
        for each in sorted(taken, key=lambda each: names.index(each.name))
    }


def _texts(facts: Mapping[str, Any]) -> dict[str, str]:
    return {name: value if isinstance(value, str) else json.dumps(value) for name, value in facts.items()}
