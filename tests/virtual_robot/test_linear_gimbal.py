import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from archerfish.records.errors import InputError
from archerfish.virtual_robot import gimbal_physics
from archerfish.virtual_robot.description import TICK_S
from archerfish.virtual_robot.gimbal_physics import make_physics
from archerfish.virtual_robot.linear_gimbal import LinearGimbal, axis_inertias

from .made_robots import changed, resting_robot


@pytest.mark.parametrize("damping", [0.0, 1e-12, 0.02, 0.3])
def test_it_steps_a_damped_axis_exactly(damping: float) -> None:
    gimbal = changed(gimbal__pitch__damping_n_m_s_per_rad=damping).gimbal
    physics = LinearGimbal(gimbal, 1)
    physics.reset(np.array([[0.05, 0.0]]))
    torque = 0.05 * np.sin(np.arange(60))
    for each in torque:
        physics.step(np.array([[each, 0.0]]))
    inertia = axis_inertias(gimbal)[0]
    state = np.array([0.05, 0.0])
    for each in torque:
        held = solve_ivp(
            lambda _, x, held=each: [x[1], (held - damping * x[1]) / inertia],
            (0, TICK_S),
            state,
            rtol=1e-10,
            atol=1e-12,
        )
        state = held.y[:, -1]
    assert physics.angle[0, 0] == pytest.approx(state[0], abs=1e-9)
    assert physics.rate[0, 0] == pytest.approx(state[1], abs=1e-8)


def test_its_stops_take_all_speed() -> None:
    physics = LinearGimbal(changed().gimbal, 1)
    physics.reset(np.zeros((1, 2)))
    for _ in range(2000):
        physics.step(np.array([[1.0, -1.0]]))
    np.testing.assert_allclose(np.degrees(physics.angle), [[13.0, -80.0]])
    np.testing.assert_array_equal(physics.rate, 0.0)


def test_without_mujoco_the_stand_in_takes_its_place_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gimbal_physics, "mujoco_installed", lambda: False)
    gimbal = changed().gimbal
    with pytest.warns(UserWarning, match=r"MuJoCo 4 is not installed: a linear stand-in .* pip install"):
        assert isinstance(make_physics(gimbal, 3), LinearGimbal)
    with pytest.raises(InputError, match="needs MuJoCo 4"):
        make_physics(gimbal, 3, "mujoco")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert isinstance(make_physics(gimbal, 3, "linear"), LinearGimbal)


def fake_mujoco(folder: Path, package: str, batch: str | None) -> dict[str, str]:
    """Write a package called mujoco, and return the environment of a process that finds it first."""
    (folder / "mujoco").mkdir()
    (folder / "mujoco" / "__init__.py").write_text(package)
    if batch is not None:
        (folder / "mujoco" / "batch.py").write_text(batch)
    return {"PYTHONPATH": f"{folder}:{Path(__file__).parents[2] / 'src'}"}


ASK = """
import sys
from archerfish.virtual_robot.gimbal_physics import mujoco_installed
print(mujoco_installed(), "mujoco" in sys.modules)
"""


@pytest.mark.parametrize(("batch", "installed"), [(None, "False"), ("", "True")])
def test_a_mujoco_is_installed_if_it_has_batches_and_is_not_imported_to_know(
    tmp_path: Path, batch: str | None, installed: str
) -> None:
    environment = fake_mujoco(tmp_path, "", batch)
    done = subprocess.run(
        [sys.executable, "-c", ASK], capture_output=True, text=True, env=environment, timeout=60, check=True
    )
    assert done.stdout.split() == [installed, "False"]


WRAPPED_INTERRUPT = """
try:
    raise KeyboardInterrupt
except KeyboardInterrupt as interrupt:
    raise ImportError("initialization failed") from interrupt
"""


@pytest.mark.parametrize(
    ("package", "status", "told"),
    [
        ("raise ImportError('libGL.so: no such file')", 2, "MuJoCo is installed but can't be imported (libGL.so"),
        (WRAPPED_INTERRUPT, 130, "interrupted"),
    ],
    ids=["broken", "Ctrl-C while it is loaded"],
)
def test_no_stand_in_takes_the_place_of_an_installed_mujoco(
    tmp_path: Path, package: str, status: int, told: str
) -> None:
    environment = fake_mujoco(tmp_path, package, "")
    words = ["record", "step", "--no-validation", "--hold-s", "0.1", "--out", str(tmp_path / "out")]
    script = f"from archerfish.cli.main import main; main({words!r})"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, env=environment, timeout=60, check=False
    )
    assert done.returncode == status, done.stderr
    assert told in done.stderr
    assert not (tmp_path / "out").exists()


def test_the_robot_on_the_stand_in_reaches_its_command() -> None:
    robot = resting_robot(changed(), 2, "linear")
    robot.send(np.array([[0.05, 0.2], [-0.1, -0.3]]))
    robot.advance(600)
    expected = np.array([[0.05 * 1.03, 0.2], [-0.1 * 1.03, -0.3]])
    np.testing.assert_allclose(robot.truth().angle, expected, atol=2e-3)


WITHOUT_MUJOCO = """
import sys, warnings
import numpy as np

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "mujoco":
            raise ModuleNotFoundError(f"{name} is not installed", name=name)

sys.meta_path.insert(0, Absent())
from archerfish.targets.still import Static
from archerfish.virtual_robot.description_file import load_robot
from archerfish.virtual_robot.robot import VirtualRobot

with warnings.catch_warnings(record=True) as notices:
    warnings.simplefilter("always")
    robot = VirtualRobot(load_robot("infantry"), 1, np.array([0]))
robot.reset(np.zeros((1, 2)), Static(np.array([[3.0, 0.0, 0.0]])))
robot.advance(20)
print(len(notices), notices[0].message)
"""


def test_a_process_without_mujoco_runs_the_robot() -> None:
    environment = {"PYTHONPATH": str(Path(__file__).parents[2] / "src")}
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_MUJOCO], capture_output=True, text=True, env=environment, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1 MuJoCo 4 is not installed")
