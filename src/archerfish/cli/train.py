"""`archerfish train`: a policy for a gimbal, from its records."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from archerfish.cli.compilation_cache import keep_compiled
from archerfish.cli.options import DrawnTarget, Folder, JsonFile, Observation, OwnMotionName, PaperTarget, Switch
from archerfish.cli.outputs import Outputs, make_writer
from archerfish.cli.progress import note, progress_bar, require_jax
from archerfish.cli.restored_options import contradictions, restore_options, with_default_flags
from archerfish.cli.setting import (
    PLANTS,
    RobotOptions,
    Setting,
    SettingFiles,
    both_axes,
    configuration,
    is_own_plant,
    load_setting,
)
from archerfish.cli.setting_remarks import setting_remarks
from archerfish.cli.training_defaults import GradientOptions, resolved
from archerfish.learning.config import PpoConfig
from archerfish.plugins import code_file_name, names_code, not_run, same_code_name
from archerfish.records.errors import InputError, file_error
from archerfish.records.plant import PlantRecord
from archerfish.records.provenance import code_commit, library_versions
from archerfish.records.storage import field as field_of
from archerfish.records.storage import file_hash
from archerfish.simulation.scenario import TARGETS
from archerfish.targets.drawn import DRAWN

if TYPE_CHECKING:
    from archerfish.cli.training_run import TrainingTask
    from archerfish.targets.own_motion import OwnMotion

MOST_FRAMES = 64
"""More than a second of history at 20 ms; the observation grows with it."""

RESULT_FILES = (
    "policy.json",
    "policy.safetensors",
    "checkpoint.json",
    "checkpoint.safetensors",
    "log.jsonl",
    "curve.svg",
    "config.json",
)
"""What a finished training leaves in its run folder, beside the files for TensorBoard."""


@dataclass(frozen=True)
class Train:
    """Train a policy in the simulator of a gimbal.

    Without files this is the paper's printed gimbal under our assumed conditions. Train with the command limit that the
    robot has: a policy is evaluated under the same one.

    Writes policy.json and policy.safetensors (the policy record, for evaluate), checkpoint.json, curve.svg, log.jsonl
    (metrics of each update), files for TensorBoard and config.json (all settings, seed and input hashes).

    While it goes on, "unfinished" in the run folder has its log and checkpoints; results of an earlier run stay until
    the new ones are there. However a training was ended, --resume goes on with it, to the same weights.

    Examples:
      archerfish train --seed 1 --out runs/train
      archerfish train --pitch pitch.json --yaw yaw.json --muzzle muzzle.json --robot infantry
      archerfish train --pitch pitch.json --yaw yaw.json --muzzle muzzle.json --sensing sensing.json --robot infantry
      archerfish train --target strafe --gradient.steps 2000000
      archerfish train --target dynamic --command-limit box --ppo.steps 4000000
      archerfish train --target paper --trainer gradient --seed 1
      archerfish train --resume runs/train
      archerfish train --resume runs/train --motion ./departure.py:Departure
    """

    setting: RobotOptions = field(default_factory=SettingFiles)
    """The robot."""
    target: Annotated[
        PaperTarget | DrawnTarget | None, tyro.conf.arg(help_behavior_hint="(default: any, or paper with --motion)")
    ] = None
    """Who is shot at: targets that stand still or move in any way (any), or in one way alone (still to singer,
    docs/targets.md); or the paper's, of which half stand still (paper), all do (static), or none does (dynamic)."""
    observation: Annotated[
        Observation | None,
        tyro.conf.arg(
            help_behavior_hint="(default: multimodel; for the paper's targets tracked with --sensing, else history)"
        ),
    ] = None
    """What the policy sees: several frames (history), the paper's six numbers (paper), what a tracker makes of old and
    noisy sights (tracked), which needs --sensing, or what several trackers side by side make of sights of any kind
    (multimodel)."""
    frames: int = 4
    """Frames that the history observation remembers."""
    motion: OwnMotionName = ""
    """How the paper's moving targets move, in the place of eq (7): your own as ./FILE.py:NAME or MODULE:NAME
    (docs/adding.md)."""
    command_limit: Literal["box", "gate", "los-2deg"] = "gate"
    """What the gimbal may be asked: angle ranges (box), also rate and acceleration (gate), or at most 2° ahead of the
    target."""
    trainer: Annotated[
        Literal["ppo", "gradient"] | None,
        tyro.conf.arg(help_behavior_hint="(default: gradient; ppo for the paper's targets)"),
    ] = None
    """How: by trials, as the paper does (ppo), or along the simulator's own gradients and for hits that count gradually
    (gradient), which is faster and hits more."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Settings of PPO."""
    gradient: GradientOptions = field(default_factory=GradientOptions)
    """Settings of training by gradients."""
    out: Folder = Path("runs/train")
    """Folder for the policy and everything about its training."""
    resume: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Go on with the unfinished training of this run folder, with its settings; no other option is needed, and one that
    contradicts them is refused. A --motion of your own must be given again: code that only a file names is not run."""
    checkpoint_every: float = 30.0
    """Seconds between two checkpoints; at most so much is lost when the process is killed."""
    stop_at_hit_rate: Annotated[float | None, tyro.conf.arg(metavar="RATE", help_behavior_hint="")] = None
    """End early once the hit rate of the mean action is at least this, 0 to 1, at the lower end of its 95 % interval,
    over engagements that neither training nor evaluation meets. It is tried every 20 iterations, so never in a training
    of fewer."""
    tensorboard: Switch = True
    """Leave out the files for TensorBoard."""
    seed: int = 0
    """Of everything random in the training."""
    overwrite: bool = False
    """Replace files that this command did not write; never what it reads."""
    json: JsonFile = None
    """Also write what is printed to this file."""

    def outputs(self) -> Outputs:
        """Return what the command writes."""
        files, unfinished = tuple(self.out / name for name in RESULT_FILES), (self.out / "unfinished",)
        folders = (self.out / "diverged", self.out / "tensorboard")
        # A resumed training reads the copies of its records in "unfinished", and replaces none of them.
        return Outputs(files, folders, kept=unfinished) if self.resume else Outputs(files, (*unfinished, *folders))

    def resumed(self, read: Callable[[Any], Any]) -> "Train":
        """Take the settings of the run to go on with.

        Args:
          read: reads the words of the command line anew, with other defaults.

        Raises:
          InputError: if there is no unfinished run, a copy of its records is missing, an option contradicts its
            settings, or it was begun with code that no option names.
        """
        if self.resume is None:
            return self
        from archerfish.cli.live_run import configuration_file, read_configuration

        plain, source = read_configuration(self.resume), configuration_file(self.resume)
        # Where results go is this command line's to say: the folder may be somebody else's.
        begun = replace(restore_options(Train, plain, source), out=self.resume, resume=self.resume, json=None)
        said = read(with_default_flags(replace(begun, motion="")))
        motion = said.motion or _recorded_motion(begun.motion, source, plain)
        # The file may lie elsewhere by now; that it is the same, its hash says.
        if same_code_name(motion, begun.motion):
            begun = replace(begun, motion=motion)
        for option, ours, theirs in contradictions(replace(said, motion=motion), begun, MAY_CHANGE):
            raise InputError(
                f"{option} {ours} contradicts {self.resume}, which was begun with {theirs}; leave the option out, or "
                "begin another training"
            )
        return replace(
            begun,
            setting=_copies(begun.setting, self.resume),
            checkpoint_every=said.checkpoint_every,
            tensorboard=begun.tensorboard and said.tensorboard,
            overwrite=said.overwrite,
            json=said.json,
        )


MAY_CHANGE = frozenset({"checkpoint_every", "tensorboard", "overwrite", "json"})
"""Options that a resumed training may be given anew."""


def run_train(command: Train) -> dict[str, Any]:
    """Train, write the run folder, print a summary, and return what --json writes.

    Raises:
      InputError: if a record can't be used, a setting is out of range, or the training diverges.
    """
    command = resolved(command)
    _check(command)
    require_jax("train")
    keep_compiled()
    from archerfish.cli.live_run import configuration_file, live_run, read_configuration
    from archerfish.cli.training_log import has_tensorboard
    from archerfish.cli.training_run import run_task, write_run
    from archerfish.learning.shards import claim_devices

    settings = command.gradient if command.trainer == "gradient" else command.ppo
    devices = claim_devices(settings.shards)
    from archerfish.targets.own_motion import find_motion

    setting = None if command.resume else load_setting(command.setting)
    code = _code(find_motion(command.motion)) if command.motion else {}
    if command.resume is not None:
        begun = read_configuration(command.resume)
        _check_code(command, code, begun)
        _versions(begun, configuration_file(command.resume))  # refused now, if they are damaged, not in its folder
    for remark in setting_remarks(command.setting, setting) if setting else ():
        note(remark)
    tensorboard = command.tensorboard and has_tensorboard()
    writer = make_writer(command)
    with live_run(
        command.out,
        resumed=command.resume is not None,
        every_s=command.checkpoint_every,
        batch=settings.batch,
        tensorboard=tensorboard,
        writer=writer,
    ) as live:
        if setting is None:
            setting = load_setting(command.setting)
            _note_changes(read_configuration(command.out), configuration_file(command.out), devices)
        else:
            live.begin(
                {**configuration(command, setting), "devices": devices, **code}, *_files(command.setting, setting)
            )
        task = _task(command, setting)
        with progress_bar("training", task.decisions, "decisions") as advance:
            result = run_task(task, advance, live)
        write_run(live.results, result, read_configuration(command.out))
        live.publish(writer)
    summary = {
        "policy": str(command.out / "policy.json"),
        "steps": int(result.curve.steps[-1]),
        "seconds": round(result.seconds, 2),
        "mean_return": float(result.mean_return[-1]),
        "weights_sha256": result.weights_sha256,
    }
    if command.tensorboard and not tensorboard:
        summary["tensorboard"] = "not written: pip install 'archerfish[train]' brings tensorboardX"
    print_training(summary)
    return summary


def _task(command: Train, setting: Setting) -> "TrainingTask":
    """Return the training of a resolved command."""
    from archerfish.cli.training_run import TrainingTask, sees_truth

    target, observation, trainer = str(command.target), str(command.observation), str(command.trainer)
    return TrainingTask(
        setting=setting,
        static_share=TARGETS.get(target, 0.0),
        observation=observation,
        frames=command.frames,
        command_limit=command.command_limit,
        ppo=command.ppo,
        seed=command.seed,
        asymmetric=sees_truth(trainer, observation),
        stop_at_hit_rate=command.stop_at_hit_rate,
        trainer=trainer,
        gradient=command.gradient,
        motion=command.motion,
        target=target if target in DRAWN else "",
    )


def _check(command: Train) -> None:
    """Refuse what a resolved command can't mean."""
    other = "ppo" if command.trainer == "gradient" else "gradient"
    untouched = {"ppo": PpoConfig(), "gradient": GradientOptions().settled(str(command.target))}
    if getattr(command, other) != untouched[other]:
        problem = f"--{other}.… says nothing to --trainer {command.trainer}"
        raise InputError(f"{problem}; leave it out, or say --trainer {other}")
    if command.observation == "history" and not 2 <= command.frames <= MOST_FRAMES:
        raise InputError(f"--frames must be from 2 (one frame shows no motion) to {MOST_FRAMES}, got {command.frames}")
    if not 0 <= command.checkpoint_every < math.inf:
        raise InputError(f"--checkpoint-every must be at least 0 s, got {command.checkpoint_every}")
    if command.stop_at_hit_rate is not None and not 0 < command.stop_at_hit_rate < 1:
        raise InputError(f"--stop-at-hit-rate must be between 0 and 1, got {command.stop_at_hit_rate}")


def _files(files: SettingFiles, setting: Setting) -> tuple[dict[str, Path], dict[str, PlantRecord]]:
    """Return the records that a training reads, by the option that names each, and the plants that come from code."""
    paths = {name: value for name, value in vars(both_axes(files)).items() if isinstance(value, Path)}
    plants: dict[str, PlantRecord] = {"pitch": setting.pitch, "yaw": setting.yaw}
    own = {axis: plant for axis, plant in plants.items() if axis in paths and is_own_plant(paths[axis])}
    return {name: path for name, path in paths.items() if name not in own}, own


def _copies(files: SettingFiles, out: Path) -> SettingFiles:
    """Return an unfinished run's copies of the records that it names, plants that came from code among them.

    Raises:
      InputError: if one is missing.
    """
    from archerfish.cli.live_run import input_copy

    plants = ("pitch", "yaw") if any(getattr(files, name) for name in PLANTS) else ()
    others = (name for name in ("muzzle", "sensing", "limits") if getattr(files, name))
    copies: dict[str, Any] = {name: input_copy(out, name) for name in (*plants, *others)}
    return replace(files, plant="", **copies)


def _recorded_motion(motion: str, source: Path, begun: dict[str, Any]) -> str:
    """Return the motion that an unfinished run names.

    Raises:
      InputError: if that is code, which the command line must name.
    """
    if names_code(motion):
        digest = begun.get("motion_sha256")
        raise not_run(source, {"--motion": motion}, {code_file_name(motion): str(digest)} if digest else {})
    return motion


def _code(motion: "OwnMotion") -> dict[str, str]:
    """Return what tells whether a file of code that is read anew by a resumed training is still the same."""
    file = motion.extension.file
    return {} if file is None else {"motion_sha256": file_hash(file)}


def _check_code(command: Train, code: dict[str, str], begun: dict[str, Any]) -> None:
    """Refuse to go on with other motions: half of such a training would be for neither."""
    was, now = begun.get("motion_sha256"), code.get("motion_sha256")
    if was == now:
        return
    problem = f"has changed since {command.resume} was begun with --motion {command.motion}"
    remedy = "put the file back as it was, or begin another training with another --out"
    if was is None:
        problem = f"can't be compared: {command.resume} holds no hash of the motion that it was begun with"
        remedy = "begin another training with another --out"
    raise file_error(Path(command.motion.rpartition(":")[0] or command.motion), problem, remedy)


def _versions(begun: dict[str, Any], source: Path) -> dict[str, Any]:
    """Return the versions of code and libraries that an unfinished run was begun with: name → version.

    Raises:
      InputError: if its configuration does not say.
    """
    made = field_of(source, begun, "provenance", dict)
    return {**field_of(source, made, "versions", dict), "commit": field_of(source, made, "commit", str)}


def _note_changes(begun: dict[str, Any], source: Path, devices: int) -> None:
    """Say where other code, libraries or devices may give other weights than those that the training began with."""
    was = {**_versions(begun, source), "devices": begun.get("devices", devices)}
    now = {**library_versions(), "commit": code_commit(), "devices": devices}
    changed = [f"{name} {was.get(name)} → {now.get(name)}" for name in now if was.get(name) != now.get(name)]
    if changed:
        note(f"since the training began: {', '.join(changed)}; the weights may differ from those of an unbroken one")


def print_training(summary: dict[str, Any]) -> None:
    """Print the outcome of a training."""
    from rich.console import Console
    from rich.table import Table

    table = Table(title="training", show_header=False)
    table.add_column()
    table.add_column(overflow="fold")
    for name, value in summary.items():
        table.add_row(name.replace("_", " "), f"{value:,.3f}" if isinstance(value, float) else str(value))
    Console().print(table)
