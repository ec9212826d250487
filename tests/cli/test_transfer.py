"""From a robot's logs to shots with it, in short: recordings of seconds, a training of a moment."""

import ast
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli import lab_stage
from archerfish.cli.evaluation_run import (
    EvaluationTask,
    make_ground,
    run_evaluation,
    tune_controllers,
    with_tuning,
)
from archerfish.cli.lab_stage import LabTask, run_recording
from archerfish.cli.robot_identification import (
    IdentifyTask,
    run_axis,
    run_sensing_and_muzzle,
    step_beside_model,
    trimmed,
)
from archerfish.cli.setting import Setting, with_muzzle
from archerfish.cli.training_run import TrainingTask, run_task
from archerfish.cli.transfer import QUICK_ENGAGEMENTS, QUICK_STEPS, Transfer, others, shortened
from archerfish.controllers.roster import Tuning
from archerfish.evaluation.transfer import drops
from archerfish.evaluation.tuning import BUDGET
from archerfish.identification.axis import order_choice
from archerfish.learning.config import PpoConfig
from archerfish.paper.conditions import assumed_conditions
from archerfish.records.errors import InputError
from archerfish.records.limits import read_limits
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import Recording
from archerfish.virtual_robot import description_file
from archerfish.virtual_robot.lab import timing

SOURCE = Path(__file__).parents[2] / "src" / "archerfish"
ROBOTS = Path(description_file.__file__).parent / "robots"
TINY = PpoConfig(steps=1, environments=64, rollout=10, minibatches=2, hidden=16)


def identified(logs: Path, records: Path) -> Setting:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(order_choice, "ORDERS", (2, 3))  # the two that are chosen; each takes its time
        return identified_with_few_orders(logs, records)


def identified_with_few_orders(logs: Path, records: Path) -> Setting:
    yaw, pitch = (run_axis(IdentifyTask(logs, records, 0, axis)) for axis in ("yaw", "pitch"))
    sensing, muzzle, landings = run_sensing_and_muzzle(IdentifyTask(logs, records, 0))
    assert len(landings) == 9
    assert max(abs(row.error_percent) for row in landings) < 5
    return Setting(
        name="identified-mine",
        pitch=pitch[0],
        yaw=yaw[0],
        muzzle=muzzle,
        sensing=sensing,
        limits=read_limits(logs / "limits.json"),
        conditions=with_muzzle(assumed_conditions(), muzzle),
        inputs=(),
    )


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Path:
    """A robot's file, which is replaced by another robot's as soon as its logs are recorded."""
    path = tmp_path_factory.mktemp("robot") / "mine.toml"
    shutil.copy(ROBOTS / "infantry.toml", path)
    return path


@pytest.fixture(scope="module")
def logs(robot, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lab_stage, "SWEEP_S", 4.0)
        patch.setattr(lab_stage, "HOLD_S", 1.2)
        patch.setattr(lab_stage, "LANDINGS", 4)
        plan = timing.TimingPlan(sweep_s=8.0, steps=6)
        patch.setattr(lab_stage, "timing_plan", lambda _: plan)
        for kind, axis in (("axis", "yaw"), ("axis", "pitch"), ("timing", ""), ("plates", ""), ("ground", "")):
            run_recording(LabTask(kind, str(robot), folder, 1, axis))
    shutil.copy(ROBOTS / "worn.toml", robot)
    return folder


@pytest.fixture(scope="module")
def setting(logs, tmp_path_factory) -> Setting:
    return identified(logs, tmp_path_factory.mktemp("records"))


def test_short_logs_tell_what_the_robot_is(setting) -> None:
    # What infantry.toml says, not what stands in the file by now.
    camera, link = setting.sensing.camera, setting.sensing.link
    assert camera.time_offset == pytest.approx(6.5e-3, abs=2e-3)
    assert camera.latency == pytest.approx(35e-3, abs=5e-3)
    assert link.command_latency == pytest.approx(10e-3, abs=2e-3)
    assert setting.muzzle.length == pytest.approx(0.16)
    assert len(setting.pitch.A) >= 2


def test_a_step_and_its_model_begin_at_rest_whatever_becomes_of_them() -> None:
    # A first-order model beside an axis that comes to rest far short of it, 5° off zero: an offset that were fitted
    # to all of it would lift or sink the model's beginning.
    plant = PlantRecord(
        A=np.array([[0.9]]), B=np.array([[0.1]]), C=np.eye(1), D=np.zeros((1, 1)), delay_samples=0, sample_period_s=1e-3
    )
    command = np.where(np.arange(600) < 300, 0.0, np.radians(30.0))
    reached = np.where(np.arange(600) < 300, 0.0, np.radians(12.0))
    angle = np.radians(5.0) + reached
    log = Recording(np.arange(600) / 1e3, command[:, None], angle[:, None], ("u",), ("y",), 1e-3)
    step = step_beside_model("yaw", log, plant)
    assert (step.size_deg, step.time_s[0]) == (30.0, 0.0)
    assert (step.measured_deg[0], step.model_deg[0]) == (pytest.approx(12.0), 0.0)
    assert step.model_deg[-1] == pytest.approx(30.0, abs=0.01)


def test_what_was_identified_does_not_change_with_the_description(logs, setting, robot, tmp_path) -> None:
    robot.write_text("nothing that could be read")
    again = identified(logs, tmp_path)
    for name in ("pitch", "yaw"):
        assert np.array_equal(getattr(again, name).A, getattr(setting, name).A)
    assert again.sensing.camera == setting.sensing.camera
    assert again.muzzle.speed == setting.muzzle.speed


@pytest.mark.parametrize("package", ["identification", "simulation", "controllers", "learning", "evaluation"])
def test_no_package_that_learns_or_judges_knows_the_virtual_robot(package) -> None:
    for path in (SOURCE / package).rglob("*.py"):
        assert "virtual_robot" not in path.read_text(), path


def test_the_stages_between_recording_and_shooting_do_not_import_the_robot() -> None:
    for name in ("lab_files", "robot_identification", "training_run", "setting"):
        tree = ast.parse((SOURCE / "cli" / f"{name}.py").read_text())
        modules = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        assert not [module for module in modules if "virtual_robot" in module or "lab_stage" in module], name


def test_a_policy_for_the_robot_trains_and_shoots_with_it(setting, monkeypatch) -> None:
    monkeypatch.setattr("archerfish.cli.evaluation_run.TUNING_ENGAGEMENTS", 2)
    policy = run_task(TrainingTask(setting, 0.5, "tracked", 0, "gate", TINY, 0)).policy
    untuned = EvaluationTask(setting, "gate", 2, 0, ("kalman",), (policy,), tables=("IV", "V"))
    task = with_tuning(untuned)
    (tuned,) = tune_controllers(untuned)
    assert task.tuning == {"kalman": tuned.tuning}
    simulated = run_evaluation(task)
    # A call without settings finds them itself, as the command line does.
    for ours, theirs in zip(run_evaluation(untuned), simulated, strict=True):
        assert np.array_equal(ours.hit, theirs.hit)
    on_robot = replace(task, robot="infantry")
    shot = run_evaluation(on_robot)
    ground = make_ground(on_robot)
    assert [each.name for each in shot] == ["kalman", "history"]
    assert ground.setting == "infantry"
    # Untrained it is auto-aim without lead, which hits still targets once it has settled.
    assert all(each.hit[:4, :, 25:].mean() > 0.5 for each in (*simulated, *shot))
    found = drops(ground, shot, simulated)
    assert len(found) == 2 * 8 * 2
    assert {(each.table, each.settled) for each in found} == {(t, s) for t in ("IV", "V") for s in (True, False)}
    assert all(each.low <= each.difference <= each.high for each in found)


def test_first_shots_correct_the_muzzle_of_a_robot_that_has_changed(setting, tmp_path) -> None:
    run_recording(LabTask("trim", "worn", tmp_path, 3))
    assert (tmp_path / "robot.toml").read_bytes() == (ROBOTS / "worn.toml").read_bytes()
    changed = trimmed(setting, tmp_path / "first_shots.csv")
    assert changed.muzzle.speed < setting.muzzle.speed
    assert changed.muzzle.length == setting.muzzle.length
    assert changed.conditions.muzzle_speed == changed.muzzle.speed
    assert changed.yaw is setting.yaw


def test_a_quick_run_states_what_it_does() -> None:
    quick = shortened(Transfer(quick=True))
    assert (quick.ppo.steps, quick.engagements) == (QUICK_STEPS, QUICK_ENGAGEMENTS)
    assert quick.ppo.discount == Transfer().ppo.discount
    assert shortened(replace(quick, engagements=2)).engagements == 2


def test_trackers_are_tuned_on_draws_of_their_own(setting, monkeypatch) -> None:
    monkeypatch.setattr("archerfish.cli.evaluation_run.TUNING_ENGAGEMENTS", 2)
    (tuned,) = tune_controllers(EvaluationTask(setting, "gate", 2, 0, ("parabola-lq", "oracle")))
    assert tuned.controller == "parabola-lq"
    assert set(tuned.neighbours) == {"smoothing", "extra_lead_s"}
    assert 5 <= len(tuned.tried) <= BUDGET
    assert 0 < tuned.hit_rate < 1


def test_settings_that_were_given_are_kept(setting) -> None:
    given = {"kalman": Tuning(3.0, -0.04)}
    assert with_tuning(EvaluationTask(setting, "gate", 2, 0, ("kalman", "oracle"), tuning=given)).tuning == given


def test_a_tracked_policy_needs_to_know_camera_and_link(setting) -> None:
    task = TrainingTask(replace(setting, sensing=None), 0.5, "tracked", 0, "gate", TINY, 0)
    with pytest.raises(InputError, match="needs a sensing record"):
        run_task(task)
    with pytest.raises(InputError, match="needs a sensing record"):
        make_ground(EvaluationTask(replace(setting, sensing=None), "gate", 2, 0, robot="infantry"))


def test_a_robot_is_not_one_of_those_that_it_has_changed_into(tmp_path) -> None:
    copy, other = tmp_path / "copy.toml", tmp_path / "other.toml"
    shutil.copy(ROBOTS / "worn.toml", copy)
    other.write_text(copy.read_text().replace("rate_hz = 80", "rate_hz = 60"))
    assert others("infantry", ("worn", str(copy))) == ("worn",)
    assert others("worn", ("worn",)) == others(str(copy), ("worn",)) == ()
    with pytest.raises(InputError, match="another robot is called worn too"):
        others(str(other), ("worn",))
