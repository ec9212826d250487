import pytest

from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.viewer.choice import Choice, Subject


@pytest.fixture(scope="session")
def subject() -> Subject:
    """The paper's gimbal under the command limit `gate`."""
    setting = load_setting(SettingFiles())
    return Subject(
        name=setting.name,
        pitch=setting.pitch,
        yaw=setting.yaw,
        muzzle=setting.muzzle,
        sensing=setting.sensing,
        limits=setting.limits,
        conditions=setting.conditions,
        command_limit="gate",
    )


@pytest.fixture(scope="session")
def choice() -> Choice:
    return Choice("kalman", "parabola (the paper's)", engagements=4)
