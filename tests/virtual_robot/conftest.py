"""Virtual robots to test with."""

import re
from importlib import resources

import pytest

from archerfish.virtual_robot.virtual_robot import VirtualRobot

NOISE = "lateral_sd_mm range_sd_percent miss_probability stamp_jitter_ms"
QUIET = {f"firmware.{axis}.gyro_noise_rad_per_s": 0 for axis in ("pitch", "yaw")}
QUIET |= {f"camera.{name}": 0 for name in NOISE.split()}
EXACT = {"speed_sd_m_s", "droop_per_shot_m_s", "boresight_pitch_deg", "boresight_yaw_deg"}
EXACT |= {"dispersion_pitch_deg", "dispersion_yaw_deg"}


@pytest.fixture
def changed_robot(tmp_path):
    """Return infantry with other values, named as `gimbal.yaw.friction_n_m`, without noise unless `noisy`."""
    pytest.importorskip("mujoco")
    original = resources.files("archerfish").joinpath("virtual_robot", "robots", "infantry.toml").read_text()

    def change(values=None, *, noisy=False, exact=False):
        text, without = original, {f"muzzle.{name}": 0 for name in EXACT if exact} | ({} if noisy else QUIET)
        for place, value in (without | (values or {})).items():
            table, _, key = place.rpartition(".")
            pattern = rf"(?s)(\[{re.escape(table)}\](?:(?!\n\[).)*?\n{key} = )[^\n]*"
            text, count = re.subn(pattern, lambda found, value=value: f"{found[1]}{value}", text)
            assert count == 1, place
        path = tmp_path / "changed.toml"
        path.write_text(text)
        return VirtualRobot.load(path)

    return change
