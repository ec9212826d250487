"""What a robot's computer is connected to and runs: deploy.toml in the robot's folder."""

from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from archerfish.records.json_files import read_toml, to_struct
from archerfish.records.record import Struct, Text
from archerfish.safety.rules import GateConfig

FILE = "deploy.toml"
_REMEDY = "correct it; docs/deployment.md has every line"
_Metres = Annotated[float, Meta(ge=-5.0, le=5.0)]


class DetectionsConfig(Struct, frozen=True, kw_only=True):
    """Where the plates come from."""

    address: Text = "127.0.0.1:47000"
    """IP address and UDP port on which lines of JSON are received; another than 127.0.0.1 lets others send them."""
    position_m: tuple[_Metres, _Metres, _Metres] = (0.0, 0.0, 0.0)
    """Of the camera from the gimbal's pivot, along the gimbal's axes: forward, left, up [m]."""
    latency_ms: Annotated[float, Meta(ge=0.0, le=1000.0)] | None = None
    """Mean time from an exposure to the receipt of its detections; that of the robot's records if not given [ms]."""


class ControllerConfig(Struct, frozen=True, kw_only=True):
    """What decides."""

    mode: Text = ""
    """A name of archerfish evaluate, or a policy; the folder's policy if there is one, else kalman."""
    fallback: Text = "kalman"
    """Decides from the first fault of the other one on."""


class DeployConfig(Struct, frozen=True, kw_only=True):
    """All of deploy.toml."""

    wires: tuple[Text, ...] = ("sp_vision_25",)
    """Names of those that come with Archerfish, or TOML files, which are joined; or one ./FILE.py:NAME."""
    port: Text = ""
    """Serial port, such as /dev/serial/by-id/…; given here or on the command line."""
    baud: Literal[115_200, 230_400, 460_800, 921_600, 1_000_000, 2_000_000] = 115_200
    """Of a serial line; USB has none."""
    detections: DetectionsConfig = field(default_factory=DetectionsConfig)
    """Where the plates come from."""
    controller: ControllerConfig = field(default_factory=ControllerConfig)
    """What decides."""
    gate: GateConfig = field(default_factory=GateConfig)
    """What the gate allows less than the robot's records."""


def read_config(folder: Path | None) -> DeployConfig:
    """Read deploy.toml of a robot's folder; without one, or without a folder, the defaults hold.

    Raises:
      InputError: naming file and field, if it can't be used.
    """
    path = folder / FILE if folder else None
    if path is None or not path.exists():
        return DeployConfig()
    return to_struct(read_toml(path, _REMEDY), path, DeployConfig, None, _REMEDY)
