"""What a robot's computer is connected to and runs: deploy.toml in the robot's folder."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta, field

from archerfish.errors import InputError
from archerfish.records.json_files import read_toml, to_struct
from archerfish.records.record import Struct, Text
from archerfish.robot import Robot
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

    def latency_s(self, robot: Robot) -> float:
        """Return the mean time from an exposure to the receipt of its detections [s].

        Raises:
          InputError: if neither this nor the robot's records have it.
        """
        if self.latency_ms is not None:
            return 1e-3 * self.latency_ms
        return camera_latency(robot)


class ControllerConfig(Struct, frozen=True, kw_only=True):
    """What decides."""

    mode: Text = ""
    """A name of archerfish evaluate, or a policy; the folder's policy if there is one, else kalman."""
    fallback: Text = "kalman"
    """Decides from the first fault of the other one on; "" for none."""


class DeployConfig(Struct, frozen=True, kw_only=True):
    """All of deploy.toml."""

    wires: tuple[Text, ...] = ("sp_vision_25",)
    """Names of those that come with Archerfish, or TOML files, which are joined; or one ./FILE.py:NAME."""
    yaw_reference: Literal["", "encoder", "fixed-chassis"] = ""
    """Why the range of the yaw, which is from the chassis, holds for the yaw of a wire that has no yaw_encoder beside
    it: it is the encoder's, or a gyroscope's on a chassis that stands still."""
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
    config = to_struct(read_toml(path, _REMEDY), path, DeployConfig, None, _REMEDY)
    controller = config.controller
    return config.replace(
        wires=tuple(_from_folder(wire, path.parent) for wire in config.wires),
        controller=controller.replace(
            mode=_from_folder(controller.mode, path.parent), fallback=_from_folder(controller.fallback, path.parent)
        ),
    )


@contextmanager
def setting(name: str, is_used: bool = True) -> Iterator[None]:
    """Have errors of a block say that they come from a line of deploy.toml.

    Args:
      name: of the line, as "detections.address".
      is_used: whether the block uses that line; the command line may have another value.
    """
    try:
        yield
    except InputError as error:
        place = "" if str(error).startswith(name) else f"field {name}: "
        raise (InputError(f"{FILE}: {place}{error}", error.code) if is_used else error) from error


def camera_latency(robot: Robot) -> float:
    """Return the mean time from an exposure to the receipt of its detections, by the robot's records [s].

    Raises:
      InputError: if the records don't have it, or it counts from something else.
    """
    camera = robot.sensing.camera if robot.sensing else None
    write = f"write latency_ms to [detections] of {FILE}"
    if camera is None or camera.latency is None:
        remedy = f"{write}, or record timing_plate.csv with the times of receipt, and identify again"
        raise InputError(f"{robot.name} has no latency of its camera, so no detection can be dated; {remedy}")
    if camera.latency_basis != "exposure":
        figure = f"{1e3 * camera.latency:.1f} ms, is less the delay of the gimbal's feedback"
        remedy = f"{write}, or record timing_target.csv and timing_moments.csv, and identify again"
        raise InputError(f"{robot.name}: the latency of its camera, {figure}, expected that from exposures; {remedy}")
    return camera.latency


def _from_folder(name: str, folder: Path) -> str:
    """Return a name with its file, if it has one, looked for from a folder; other names stay."""
    file, colon, attribute = name.rpartition(":") if ":" in name else (name, "", "")
    is_file = "/" in file or file.endswith((".toml", ".py"))
    return f"{folder / file}{colon}{attribute}" if is_file else name
