import hashlib
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from archerfish.controllers.guarded_policy import controller_from_record
from archerfish.controllers.policy import TRACKING
from archerfish.deployment import export as export_module
from archerfish.deployment.export import export_policy
from archerfish.records.errors import InputError
from archerfish.records.policy import read_policy

KINDS = ("history", "paper", "tracked", "multimodel")
BAR = 1e-5


@pytest.fixture
def exported(policy_file, agreement, tmp_path):
    """Export a policy of a kind: its controller in NumPy, and the session that runs it."""

    def export(kind: str):
        path = policy_file(kind)
        export_policy(path, tmp_path / "policy.onnx")
        return controller_from_record(read_policy(path)), agreement.runtime(tmp_path / "policy.onnx")

    return export


def metadata_of(path: Path) -> dict[str, str]:
    onnx = pytest.importorskip("onnx")
    return {each.key: each.value for each in onnx.load(path).metadata_props}


@pytest.mark.parametrize("kind", KINDS)
def test_numpy_jax_and_onnx_runtime_agree_over_sequences(kind, exported, inputs, agreement) -> None:
    # 10^5 decisions of all kinds together with the edges below; the memory of each is its own.
    frames = inputs.lively_frames(40, 500, 3, inputs.NOISE_M[kind])
    commands = agreement.commands_of_sequences(*exported(kind), frames, carried=True)
    assert max(agreement.largest_differences(commands).values()) < BAR
    assert not np.any(np.isnan(commands["NumPy"]))


@pytest.mark.parametrize("kind", KINDS)
def test_they_agree_at_the_edges(kind, exported, inputs, agreement) -> None:
    frames = inputs.edge_frames(15_000, 4, signed_zeros=kind not in TRACKING)
    with np.errstate(all="ignore"):  # at the pivot there is no direction
        commands = agreement.first_commands(*exported(kind), frames)
    assert max(agreement.largest_differences(commands).values()) < BAR
    at_pivot = np.all(frames.plate[:, 0] == 0.0, axis=-1)
    assert np.all(np.isnan(commands["ONNX Runtime"][at_pivot]).any(axis=-1))


def test_a_nan_comes_out_as_nan_and_is_forgotten_with_the_next_engagement(exported, inputs, agreement) -> None:
    policy, session = exported("tracked")
    frames = inputs.lively_frames(3, 4, 5, 0.005)
    frames.plate[1, 0] = np.nan
    commands = agreement.commands_of_sequences(policy, session, frames, carried=True)
    for each in commands.values():
        assert np.all(np.isnan(each).any(axis=(0, 2)) == [True, False, False, False])
    after = agreement.first_commands(policy, session, type(frames)(*(each[0] for each in frames)))
    assert not np.any(np.isnan(after["ONNX Runtime"]))


def test_one_robot_gets_what_it_gets_in_a_batch(exported, inputs, agreement) -> None:
    _, session = exported("tracked")
    seen = type(frames := inputs.lively_frames(1, 5, 6, 0.005))(*(each[0] for each in frames))
    state = np.zeros((5, 61), np.float32)
    feed = agreement.inputs_of(session, seen, np.ones(5, bool), state)
    together = session.run(["angle_command"], feed)[0]
    for member in range(5):
        alone = session.run(["angle_command"], {name: each[member : member + 1] for name, each in feed.items()})[0]
        np.testing.assert_allclose(alone[0], together[member], atol=1e-6)


def test_a_file_says_when_a_policy_falls_back(exported, inputs, agreement) -> None:
    policy, session = exported("multimodel")
    frames = inputs.lively_frames(60, 50, 7, 0.0)
    start = type(frames)(*(each[0] for each in frames))
    memory, state = (
        policy.reset(start),
        np.zeros((50, next(i.shape[1] for i in session.get_inputs() if i.name == "state"))),
    )
    said, meant = [], []
    for decision in range(60):
        seen = type(frames)(*(each[decision] for each in frames))
        feed = agreement.inputs_of(session, seen, np.full(50, decision == 0), state.astype(np.float32))
        state, fallback = session.run(["next_state", "fallback"], feed)
        memory, command = policy.step(memory, seen)
        said.append(fallback)
        meant.append(command.fallback)
    assert np.array(said).shape == (60, 50)
    assert 0.1 < np.mean(meant) < 0.9
    # Where policy and filter have nearly equal parts, rounding decides.
    assert np.mean(np.array(said) == np.array(meant)) > 0.999


@pytest.mark.parametrize("kind", KINDS)
def test_the_file_tells_all_that_its_user_must_know(kind, policy_file, tmp_path) -> None:
    onnx = pytest.importorskip("onnx")
    path = policy_file(kind)
    facts = export_policy(path, tmp_path / "policy.onnx")
    told = metadata_of(tmp_path / "policy.onnx")
    assert told["record_sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()
    assert told["arrays_sha256"] == json.loads(path.read_text())["arrays_sha256"]
    assert "rad" in told["units"]
    assert "pitch positive with the muzzle up" in told["frame"]
    assert float(told["decision_period_s"]) == 0.02
    assert json.loads(told["command_limits"])["trained_under"] == "gate"
    observation = json.loads(told["observation"])
    assert observation["kind"] == kind
    assert sum(size for _, size in observation["layout"]) == observation["size"]
    graph = onnx.load(tmp_path / "policy.onnx").graph
    assert list(json.loads(told["inputs"])) == sorted(json.loads(told["inputs"]), key=list(facts["inputs"]).index)
    assert {each.name for each in graph.input} == set(json.loads(told["inputs"]))
    assert {each.name for each in graph.output} == set(json.loads(told["outputs"]))
    size = next(each.type.tensor_type.shape.dim[1].dim_value for each in graph.input if each.name == "state")
    assert sum(int(np.prod(each["shape"])) for each in json.loads(told["state"])) == size
    assert all(each.type.tensor_type.shape.dim[0].dim_param == "batch" for each in (*graph.input, *graph.output))


def test_a_file_that_decides_otherwise_is_not_written(policy_file, tmp_path, monkeypatch) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    path, right = policy_file("tracked"), export_module.decision_graph

    def wrong(controller):
        graph = right(controller)
        return graph._replace(angle=graph.angle + 0.01)

    assert export_policy(path, tmp_path / "right.onnx")["checked_rad"] < BAR
    monkeypatch.setattr(export_module, "decision_graph", wrong)
    with pytest.raises(InputError, match=r"would command up to 0\.01 rad otherwise"):
        export_policy(path, tmp_path / "wrong.onnx")
    assert not (tmp_path / "wrong.onnx").exists()
    assert export_policy(path, tmp_path / "wrong.onnx", check=False)["checked_rad"] is None


def test_a_file_that_commands_nan_is_not_written(policy_file, tmp_path, monkeypatch) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    right = export_module.decision_graph

    def wrong(controller):
        graph = right(controller)
        return graph._replace(angle=graph.angle + np.float32("nan"))

    monkeypatch.setattr(export_module, "decision_graph", wrong)
    with pytest.raises(InputError, match="no finite number"):
        export_policy(policy_file("paper"), tmp_path / "wrong.onnx")
    assert not (tmp_path / "wrong.onnx").exists()


def test_the_same_policy_gives_the_same_file(policy_file, tmp_path) -> None:
    pytest.importorskip("onnx")
    path = policy_file("tracked")
    for name in ("one.onnx", "two.onnx"):
        export_policy(path, tmp_path / name)
    assert (tmp_path / "one.onnx").read_bytes() == (tmp_path / "two.onnx").read_bytes()


def test_no_other_file_is_written_over(policy_file, tmp_path) -> None:
    path = policy_file("paper")
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"does not end in \.onnx; give a name that does"):
        export_policy(path, path)
    assert path.read_bytes() == before


def test_a_missing_onnx_is_named_with_its_remedy(policy_file, tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(InputError, match=r"needs onnx, which is not installed; pip install 'archerfish\[export\]'"):
        export_policy(policy_file("paper"), tmp_path / "policy.onnx")
    assert not (tmp_path / "policy.onnx").exists()


def test_the_file_runs_where_archerfish_is_not(policy_file, tmp_path) -> None:
    pytest.importorskip("onnx")
    pytest.importorskip("onnxruntime")
    export_policy(policy_file("tracked"), tmp_path / "policy.onnx")
    script = """
import sys, numpy, onnxruntime
session = onnxruntime.InferenceSession(sys.argv[1])
kinds = {"tensor(float)": "f4", "tensor(bool)": "?"}
feed = {each.name: numpy.ones([1, *each.shape[1:]], kinds[each.type]) for each in session.get_inputs()}
assert session.run(["angle_command"], feed)[0].shape == (1, 2)
assert "archerfish" not in sys.modules
"""
    subprocess.run([sys.executable, "-I", "-c", script, str(tmp_path / "policy.onnx")], check=True, timeout=60)
