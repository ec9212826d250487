"""Logs and records that the pages' commands read: a robot in short, made once for all pages."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.signal import cont2discrete, lfilter

from archerfish.cli.main import main
from archerfish.deployment.export import export_policy
from archerfish.identification.axis.state_space import simulate
from archerfish.paper.gimbal import printed_plants
from archerfish.records.plant import PlantRecord, write_plant
from archerfish.records.policy import PolicyRecord, write_policy
from archerfish.records.recording import make_recording, write_recording_csv

from .pages import ROOT, blocks

PERIOD_S = 0.005
OLD = "runs/old"
"""Folder of the recordings with a virtual robot."""


def make(folder: Path) -> None:
    """Lay down every product in a folder, which is the working folder."""
    for axis, seed in (("pitch", 1), ("yaw", 4)):
        for name, offset in (("sweep", 0), ("step", 1), ("step_2", 2)):
            _axis_log(folder / f"{axis}_{name}.csv", name, seed + offset)
    _torque_log(folder / "pitch_torque.csv")
    words = ["--out", OLD, "--physics", "linear"]
    main(["record", "timing", "--duration-s", "6", "--count", "6", *words])
    main(["range", "--ground", "--shots", "5", *words])
    main(["range", "--shots", "5", "--burst", "10", *words])


def _axis_log(path: Path, kind: str, seed: int) -> None:
    state, drive = np.array([[0.0, 1.0], [-2000.0, -60.0]]), np.array([[0.0], [2000.0]])
    angle_of, none = np.array([[1.0, 0.0]]), np.zeros((1, 1))
    lag, into, *_ = cont2discrete((state, drive, angle_of, none), PERIOD_S)
    plant = PlantRecord(lag, into, angle_of, none, 1, PERIOD_S)
    time = PERIOD_S * np.arange(500)
    command = 0.02 * np.sin(2.0 * np.pi * (1.0 + 6.0 * time) * time)
    if kind != "sweep":
        command = np.where((time > 0.5) & (time < 1.5), 0.05 if kind == "step" else -0.05, 0.0)
    angle = simulate(plant, command[:, None])
    angle += 1e-4 * np.random.default_rng(seed).standard_normal(angle.shape)
    write_recording_csv(path, make_recording(command[:, None], angle, PERIOD_S))


def _torque_log(path: Path) -> None:
    """Current and angle of a pitch axis with gravity that a position loop moves through its travel."""
    inertia, damping, gravity, step = 0.02, 0.1, 0.5, 0.005
    time, angle, rate, rows = step * np.arange(2000), 0.0, 0.0, []
    for now in time:
        wanted = 0.25 * np.sin(2.0 * np.pi * 0.2 * now) + 0.1 * np.sin(2.0 * np.pi * (0.5 + 0.05 * now) * now)
        torque = 8.0 * (wanted - angle) - 0.3 * rate + gravity * np.cos(angle)
        rows.append((now, torque / 0.741, angle))
        rate += step * (torque - damping * rate - gravity * np.cos(angle)) / inertia
        angle += step * rate
    table = np.array(rows)
    table[:, 2] += 1e-4 * np.random.default_rng(7).standard_normal(len(table))
    np.savetxt(path, table, "%.9g", ",", header="time_s,current_a,angle", comments="")


TIMING = {
    "sweep.csv": "timing_sweep.csv",
    "steps.csv": "timing_steps.csv",
    "plate.csv": "timing_plate.csv",
    "target.csv": "timing_target.csv",
    "moments.csv": "timing_moments.csv",
    "commands.csv": "timing_commands.csv",
    "reports.csv": "timing_reports.csv",
}
"""Names in the pages → what `record timing` calls them."""


def _timing(made: Path, here: Path) -> None:
    for name, source in TIMING.items():
        shutil.copy(made / OLD / source, here / name)


def _landings(made: Path, here: Path) -> None:
    shutil.copy(made / OLD / "landings.csv", here / "shots.csv")


def _plates(made: Path, here: Path) -> None:
    shutil.copy(made / OLD / "shots.csv", here)


def _axes(made: Path, here: Path) -> None:
    for path in made.glob("*.csv"):
        shutil.copy(path, here)


def _pitch_as_plain_names(made: Path, here: Path) -> None:
    for name in ("sweep", "step", "step_2"):
        shutil.copy(made / f"pitch_{name}.csv", here / f"{name}.csv")


def _limits(made: Path, here: Path) -> None:
    (text,) = (each.text for each in blocks(ROOT / "docs" / "robots.md") if each.language == "json")
    for path in (here / "limits.json", here / "runs" / "infantry" / "limits.json"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def _records(*names: str, axes: tuple[str, ...] = ("pitch", "yaw")) -> Callable[[Path, Path], None]:
    """Give axes where a page takes them as known: the paper's, whose compiled programs other pages need too."""

    def lay(_: Path, here: Path) -> None:
        for name in names:
            for axis in axes:
                write_plant(here / "runs" / name / f"{axis}.json", printed_plants()[axis])

    return lay


def _bags(made: Path, here: Path) -> None:
    from tests.corpus.recorded_bags import write_bag_of_axis

    for name in ("sweep", "step"):
        time, command, angle = np.loadtxt(made / f"yaw_{name}.csv", delimiter=",", skiprows=1, unpack=True)
        write_bag_of_axis(here / f"{name}_bag", time, command, angle)
    generator = np.random.default_rng(3)
    u = np.repeat(generator.uniform(3.4, 6.4, 100), 10)
    y = lfilter([0.0, 0.0, 0.3], [1.0, -0.7], u) + 0.01 * generator.standard_normal(len(u))
    np.savetxt(here / "dryer.dat", np.column_stack([u, y]), "%.6g")


def _examples(made: Path, here: Path) -> None:
    shutil.copytree(ROOT / "examples", here / "examples")


def _policy(_: Path, here: Path) -> None:
    """Give a policy that tracks and has learned nothing."""
    size = 55
    record = PolicyRecord(
        observation="tracked",
        frames=4,
        weights=(np.zeros((size, 2), np.float32),),
        biases=(np.zeros(2, np.float32),),
        mean=np.zeros(size, np.float32),
        variance=np.ones(size, np.float32),
        action_scale=np.array([0.03, 0.1], np.float32),
        braking=np.array([0.02, 0.02], np.float32),
        muzzle={"speed": 18.0, "drag": 0.019, "length": 0.16, "pitch_offset": 0.0, "yaw_offset": 0.0},
        period_s=0.02,
        command_limit="gate",
        tracker={
            "acceleration": 3.0,
            "along": 0.001,
            "across": 0.001,
            "along_share": 0.015,
            "across_angle": 0.002,
            "initial_speed": 0.25,
        },
    )
    for folder in ("runs/train", "runs/infantry/policy"):
        write_policy(here / folder / "policy.json", record)


def _exported(made: Path, here: Path) -> None:
    _policy(made, here)
    export_policy(here / "runs" / "train" / "policy.json", here / "infantry.onnx")


GIVEN: dict[str, tuple[Callable[[Path, Path], None], ...]] = {
    "README.md": (_pitch_as_plain_names, _landings, _records("infantry", axes=("yaw",))),
    "robots.md": (_axes, _plates, _limits, _timing),
    "excitation.md": (_records("infantry"), _limits),
    "identification.md": (_axes, _landings),
    "sensing.md": (_timing,),
    "logs.md": (_bags,),
    "sweep.md": (_records("infantry", "sentry"),),
    "adding.md": (_examples,),
    "export.md": (_policy,),
}
"""Page → what its reader has before its first command."""
GIVEN_TO_PYTHON: dict[str, tuple[Callable[[Path, Path], None], ...]] = {"export.md": (_exported,)}
"""Page → what there is before its first line of Python."""
