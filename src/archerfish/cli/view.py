"""`archerfish view`: a page in the browser to play with engagements, and to look at recordings."""

import importlib.util
import threading
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from archerfish.cli.interrupts import end_by_ctrl_c, without_interrupts
from archerfish.cli.options import JsonFile
from archerfish.cli.outputs import Outputs
from archerfish.cli.policy_check import check_policy
from archerfish.cli.progress import note, progress_bar
from archerfish.cli.setting import RobotOptions, SettingFiles, load_setting, trained_for
from archerfish.cli.setting_remarks import policy_remarks, setting_remarks
from archerfish.controllers.roster import CONTROLLERS, Listed, find_controller
from archerfish.records import storage
from archerfish.records.errors import InputError, file_error
from archerfish.records.extensions import is_extension
from archerfish.records.policy import read_policy

if TYPE_CHECKING:
    from archerfish.targets.own_motion import OwnMotion
    from archerfish.viewer.choice import Choice, Subject

POLICY = "policy"
"""Name of the trained policy on the page."""


@dataclass(frozen=True)
class View:
    """Open a page in the browser to play with engagements.

    It shows robot, pellets, armor, hits, misses and the hit rate with its interval. Choose controller, target motion,
    distance, speed, dispersion and latency; drag the target by hand; let another controller meet the same engagements.

    A policy is played in the setting that it was trained for, as its run folder says; a plant in code that the folder
    names is not run unless --plant names it. A recording of a gimbal (CSV, npz, MATLAB, ROS bag, MCAP) is played as the
    angles that it holds: it has no target and no pellets.

    The page is for this machine alone, unless --host says otherwise, and changes no file. --export writes a trial as
    one animated page that needs no server, and ends.

    Examples:
      archerfish view
      archerfish view runs/train
      archerfish view --controllers kalman-lq kalman --distance-m 4
      archerfish view --controllers ./two_frames.py:TwoFrames kalman --target ./departure.py:Departure
      archerfish view sweep.csv --signals yaw=y yaw_command=u
      archerfish view runs/train --export trial.html
    """

    source: Annotated[
        tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="RUN|POLICY|RECORDING", help_behavior_hint="")
    ] = None
    """Run folder of train, policy record (policy.json), or a gimbal's recording; none for the classical controllers."""
    controllers: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="NAME…", help_behavior_hint="(default: policy kalman-lq; kalman-lq kalman without a policy)"
        ),
    ] = ()
    """Who steers first, and who meets the same engagements after it: policy, kalman, kalman-tuned, kalman-lq, imm-lq,
    parabola-lq, no-lead, vertex, oracle, or one of your own (./FILE.py:NAME, docs/adding.md)."""
    target: Annotated[str, tyro.conf.arg(metavar="NAME")] = "parabola"
    """How the target moves at first: parabola, still, straight, circle, swing, hand; pass, strafe, stop-and-go,
    sinusoid, singer, drawn-parabola, drawn-circle or any, whose speeds are their own (docs/targets.md); or one
    of your own."""
    distance_m: float = 3.0
    """Distance of the target at first."""
    setting: RobotOptions = field(default_factory=SettingFiles)
    """The robot."""
    command_limit: Annotated[
        Literal["box", "gate", "los-2deg"] | None, tyro.conf.arg(help_behavior_hint="(default: the policy's, or gate)")
    ] = None
    """What the gimbal may be asked."""
    engagements: int = 12
    """Engagements per trial, of 50 shots each."""
    time: Annotated[str, tyro.conf.arg(metavar="NAME")] = "time_s"
    """Time column of a recording."""
    signals: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="ROLE=NAME…", help_behavior_hint="(default: usual names)")
    ] = ()
    """Signals of a recording: pitch, yaw, pitch_command, yaw_command."""
    host: str = "127.0.0.1"
    """Address to listen on; others than this machine can see the page only if this says so."""
    port: int = 8080
    """Port; the next free one if it is taken, any free one if 0."""
    export: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Write a trial as one animated page (.html) instead of serving one."""
    seed: int = 0
    """Of targets and dispersion."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write the trial's choice and hits to this file, with --export."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        return Outputs(named=() if self.export is None else (self.export,), option="--export")


def run_view(command: View) -> dict[str, Any]:
    """Serve the page until Ctrl-C, or export a trial, and return what --json writes.

    Raises:
      InputError: if viser is missing, or an argument or file can't be used.
    """
    _check(command)
    policy = _policy_file(command.source)
    if command.source is not None and policy is None:
        return _serve_recording(command)
    subject = _subject(command, policy)
    first, other = _first_choice(command, subject)
    _rehearse(subject, first)
    if command.export is not None:
        return _export(command.export, subject, first)
    from archerfish.viewer.page import TrialPage  # needs viser

    return _serve(command, lambda server: TrialPage(server, subject, first, other))


def _check(command: View) -> None:
    if importlib.util.find_spec("viser") is None:
        raise InputError("archerfish view needs viser, which is not installed; pip install 'archerfish[view]'")
    if not 0 <= command.port < 2**16:
        raise InputError(f"--port must be within 0…65535, got {command.port}")
    if not 1.0 <= command.distance_m <= 8.0:
        raise InputError(f"--distance-m must be within 1…8 m, got {command.distance_m:g}")
    if len(command.controllers) > 2:
        raise InputError(f"--controllers takes two names at most, got {len(command.controllers)}")
    if command.json is not None and command.export is None:
        raise InputError("--json goes with --export: a page that is played with has no result; leave one of them out")


def _policy_file(source: Path | None) -> Path | None:
    """Return the policy record of a run folder or of a path, or None for a recording.

    Raises:
      InputError: if there is nothing, or a folder that is neither.
    """
    if source is None or source.suffix == ".json":
        return source
    if not source.is_dir() or (source / "metadata.yaml").is_file():
        return None
    if (source / "policy.json").is_file():
        return source / "policy.json"
    problem = "is a folder with neither policy.json nor metadata.yaml"
    raise file_error(source, problem, "name a run folder of archerfish train, a policy.json, or a recording")


def _subject(command: View, path: Path | None) -> "Subject":
    from archerfish.viewer.choice import Subject

    policy = None if path is None else read_policy(path)
    files = command.setting if path is None else trained_for(path, command.setting)
    setting = load_setting(files)
    for remark in setting_remarks(files, setting):
        note(remark)
    limit = command.command_limit or (policy.command_limit if policy else "gate")
    if policy is not None and path is not None:
        check_policy(path, policy, setting.conditions.control_period_s, limit)
        for remark in policy_remarks(path, policy, setting):
            note(remark)
    policies = {} if policy is None else {POLICY: policy}
    return Subject(
        name=setting.name,
        pitch=setting.pitch,
        yaw=setting.yaw,
        muzzle=setting.muzzle,
        sensing=setting.sensing,
        limits=setting.limits,
        conditions=setting.conditions,
        command_limit=limit,
        policies=policies,
        own_controllers=_own_controllers(command.controllers, policies),
        own_motions=_own_motions(command.target),
    )


def _own_controllers(names: tuple[str, ...], policies: Collection[str]) -> dict[str, Listed]:
    """Return the controllers of the user's own among those asked for, by name; others are looked at later.

    Raises:
      InputError: if one can't be found, its code fails, or two have one name.
    """
    own: dict[str, Listed] = {}
    for spec in dict.fromkeys(names):
        # What is built in comes first, as in `find_controller`.
        if spec in (*CONTROLLERS, *policies) or not is_extension(spec, "controller"):
            continue
        found = find_controller(spec)
        if found.name in own:
            raise InputError(f"--controllers has two controllers {found.name!r}; call one of them something else")
        own[found.name] = found
    return own


def _own_motions(spec: str) -> "dict[str, OwnMotion]":
    """Return the motion of the user's own, if one is asked for, by name.

    Raises:
      InputError: if it can't be found, its code fails, or it has the name of another.
    """
    from archerfish.targets.own_motion import find_motion
    from archerfish.viewer.motions import HAND, MOTIONS

    if spec in _built_in_targets() or not is_extension(spec, "motion"):
        return {}
    found = find_motion(spec)
    if found.name in (*MOTIONS, HAND, *_built_in_targets()):
        raise InputError(f"--target {spec}: there is a target {found.name!r} already; call yours something else")
    return {found.name: found}


def _built_in_targets() -> dict[str, str]:
    """Return word → name on the page."""
    from archerfish.viewer.motions import HAND, MOTIONS

    return {name.partition(" ")[0]: name for name in MOTIONS} | {"hand": HAND}


def _first_choice(command: View, subject: "Subject") -> "tuple[Choice, str]":
    from archerfish.viewer.choice import RANGES, Choice, check_choice, controller_names

    # On the page, a user's own goes by its name alone.
    names = tuple(_name_of(spec) for spec in command.controllers) or (*subject.policies, "kalman-lq", "kalman")
    known = _built_in_targets() | {name: name for name in subject.own_motions}
    target = _name_of(command.target)
    if target not in known:
        raise InputError(f"--target must be one of {', '.join(known)}, or one of your own, got {command.target!r}")
    conditions = subject.conditions
    first = Choice(
        controller=names[0],
        motion=known[target],
        distance=command.distance_m,
        speed=min(round(conditions.max_lateral_speed, 2), RANGES["speed"][1]),
        engagements=command.engagements,
        seed=command.seed,
    )
    check_choice(subject, first)
    other = names[1] if len(names) > 1 else next(each for each in controller_names(subject) if each != names[0])
    if other not in controller_names(subject):
        raise InputError(f"--controllers must be of {', '.join(controller_names(subject))}, got {other!r}")
    return first, other


def _rehearse(subject: "Subject", first: "Choice") -> None:
    """Let the user's own controllers shoot once before anything is shown or written; nothing is compiled.

    Raises:
      InputError: naming what of them can't be used.
    """
    from archerfish.viewer.motions import HAND, MOTIONS
    from archerfish.viewer.trial import run_trial

    motion = next(iter(MOTIONS)) if first.motion == HAND else first.motion
    for name in subject.own_controllers:
        # Five: unlike the number of axes and coordinates, so that shapes can't be mistaken for each other.
        run_trial(subject, replace(first, controller=name, motion=motion, engagements=5))


def _name_of(spec: str) -> str:
    return spec.rpartition(":")[2]


def _is_given(command: View, name: str) -> bool:
    return bool(getattr(command, name) != getattr(View(), name))


def _serve_recording(command: View) -> dict[str, Any]:
    from archerfish.viewer.recordings import read_gimbal_recording

    assert command.source is not None
    if command.export is not None:
        raise InputError("--export writes trials, and a recording holds none; leave it out, or name a policy")
    idle = [name for name in ("controllers", "target", "setting", "command_limit") if _is_given(command, name)]
    if idle:
        names = ", ".join("a robot's files" if name == "setting" else f"--{name.replace('_', '-')}" for name in idle)
        raise InputError(f"{command.source}: a recording is played as it is; leave out {names}, or name a policy")
    unnamed = [each for each in command.signals if not all(each.partition("="))]
    if unnamed:
        raise InputError(f"--signals takes ROLE=NAME, such as yaw={unnamed[0].strip('=')}, got {unnamed[0]!r}")
    signals = dict(each.partition("=")[::2] for each in command.signals)
    recording = read_gimbal_recording(command.source, command.time, signals)
    for remark in recording.remarks:
        note(f"{command.source}: {remark}")
    from archerfish.viewer.replay import ReplayPage  # needs viser

    return _serve(command, lambda server: ReplayPage(server, recording))


def _serve(command: View, page: Any) -> dict[str, Any]:
    from archerfish.viewer.guard import check_bindable, is_loopback
    from archerfish.viewer.server import close_server, open_server
    from archerfish.viewer.turning import keep_turning

    check_bindable(command.host)
    if not is_loopback(command.host):
        note(f"everyone who reaches {command.host} can see the page and use it, for --host says so")
    server = open_server(command.host, command.port, "Archerfish")
    try:
        built = page(server)
        if command.port not in (0, server.get_port()):
            note(f"port {command.port} is taken")
        shown = f"[{command.host}]" if ":" in command.host else command.host
        note(f"until Ctrl-C, the page is at http://{shown}:{server.get_port()}")
        with end_by_ctrl_c():
            keep_turning(server, built, threading.Event())
        note("closed")
    finally:
        close_server(server)
    return {}


def _export(path: Path, subject: "Subject", choice: "Choice") -> dict[str, Any]:
    from dataclasses import asdict

    from archerfish.viewer.export import film_pictures, write_film
    from archerfish.viewer.score import count_words
    from archerfish.viewer.trial import run_trial

    if path.suffix != ".html":
        raise file_error(path, "is to hold a page, but does not end in .html", "give a name that does")
    with without_interrupts():
        storage.check_writable(path.parent)
    trial = run_trial(subject, choice)
    with progress_bar("drawing", film_pictures(trial), "pictures") as advance:
        write_film(path, choice, trial, advance)
    note(f"wrote {path}: {choice.controller}, {count_words(trial)}")
    counts = {"hits": int(trial.hit.sum()), "shots": int(trial.fired.sum()), "withheld": int((~trial.fired).sum())}
    counts["fallbacks"] = int(trial.fallback.sum())
    return {**asdict(choice), "setting": subject.name, **counts}
