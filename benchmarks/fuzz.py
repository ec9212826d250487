"""Bad inputs, at functions and at the command line: each ends in one line, or is rightly accepted.

`python benchmarks/fuzz.py [--functions N] [--commands M] [--seed S] [--only WORD]` damages files, arguments, code of a
user's own, and commands with their surroundings (special files, full disks, closed pipes, signals, encodings). A
function has to raise an `InputError` of one printable line, a command to end with 2 and one line on standard error, or
with 130 or 143 after a signal; both may accept what they get. Nothing that exists may be lost, nothing half-written
left, and each gets 10 s of processor time and 1 GB beside what is loaded. Writes results/fuzz.json.
"""

import argparse
import contextlib
import functools
import importlib
import inspect
import io
import json
import math
import os
import random
import re
import resource
import runpy
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

import archerfish as af
from archerfish import compiled, storage
from archerfish.cli import main as command_line
from archerfish.cli.main import program
from archerfish.controllers.tuning import entry, keep
from archerfish.identification import robot_files
from archerfish.identification.simulation import simulate
from archerfish.learning.run_folder import read_run
from archerfish.provenance import code_commit, library_versions
from archerfish.studies.study import Study

ROOT = Path(__file__).parents[1]
RESULT = ROOT / "benchmarks" / "results" / "fuzz.json"
TESTS = runpy.run_path(str(ROOT / "tests" / "conftest.py"))
MOST_S, MOST_BYTES, IMPORTS_S, IMPORTS_BYTES, LONGEST_S = 10.0, 1e9, 6.0, 4e8, 240.0
TRAINING, TRAINING_BYTES = ("train", "sweep", "transfer", "reproduce"), 3e9  # compiling a training takes more
SAID_OF_A_STOP = 3  # lines: that it stops, how to continue, what ended it
TASK = af.Task.load("static").replace(ranges_m=((2, 3),))
SMALL = {"trainer": "gradient", "gradient": {"environments": 4, "hidden": 4, "window": 2, "steps": 400, "shards": 1}}
TOKENS = re.split("~", "nan~inf~1e999~-1~0~1e-300~99999999999~true~[]~{}~''~1979-05-27~=~]~;~,~#~é~\x00~\ufeff~\"")
PROGRESS = re.compile(
    r"[^:]*: [\d,]+ of [\d,]+ .*min.*|nothing in .* has changed; .*|.* is not finished and left out.*"
)
ALLOWED: dict[Any, tuple[int, ...]] = {signal.SIGINT: (130, -2), signal.SIGTERM: (143, -15)}


class Ended(NamedTuple):
    """How a case ended."""

    verdict: str  # "accepted", "refused" or "wrong"
    text: str = ""  # what was said, or what is wrong


class TooSlowError(BaseException):
    """The time is up."""


class EnoughError(Exception):
    """Raised by a callback to end a training that was accepted."""


def stop(*_: Any) -> None:
    """End a training after its first iteration."""
    raise EnoughError


def damaged_json(content: bytes, draw: random.Random) -> bytes:
    """Return JSON with faults."""
    return bytes(TESTS["_mutated"](content, draw))


def damaged_bytes(content: bytes, draw: random.Random) -> bytes:
    """Return bytes of which some are changed, cut, doubled or strange."""
    flipped, place = bytearray(content), draw.randrange(len(content))
    for _ in range(draw.choice((1, 3, 30))):
        flipped[draw.randrange(len(flipped))] ^= 1 << draw.randrange(8)
    cut, strange = content[:place], draw.choice(TESTS["STRANGE"])
    zeros = cut + bytes(100) + content[place + 100 :]
    return bytes(draw.choice((flipped, flipped, flipped, cut, content * 2, strange, zeros)))


def damaged_text(content: bytes, draw: random.Random) -> bytes:
    """Return lines of TOML or CSV with faults."""
    lines = content.decode().splitlines()
    if draw.random() < 0.15:
        return damaged_bytes(content, draw)
    for _ in range(draw.choice((1, 1, 2, 5))):
        at = draw.choice((0, draw.randrange(len(lines))))
        parts = re.split(r"(, ?| = |;)", lines[at])
        field = 2 * draw.randrange((len(parts) + 1) // 2)
        fault = draw.choice((*TOKENS, "", parts[field] * 2, parts[field][1:], draw.choice(parts)))
        other = lines[draw.randrange(len(lines))]
        new = ["".join([*parts[:field], fault, *parts[field + 1 :]])]
        lines[at : at + 1] = draw.choice(
            (new, new, new, [lines[at]] * 2, [], [other], [lines[at] + draw.choice(TOKENS)])
        )
        lines = lines or [""]
    return "\n".join([*lines, ""]).encode("utf-8", "surrogatepass")


def damaged_arrays(arrays: dict[str, Any], draw: random.Random) -> dict[str, Any]:
    """Return arrays of which one has another shape, type or values."""
    name = draw.choice(list(arrays))
    values = np.array(arrays[name])
    flat = values.astype(float).ravel()
    flat[draw.randrange(max(flat.size, 1)) :][:1] = draw.choice((math.nan, math.inf, 1e300, -1.0))
    changed: list[Any] = [
        flat.reshape(values.shape).astype(values.dtype),
        np.ravel(values)[:1],
        np.ravel(values)[:0],
        values[..., None],
    ]
    changed += [values.astype("f2"), values.astype("i1"), values * np.nan, values.T, -values, values.astype(str)]
    changed += [values.astype(complex), values.astype(object), 0 * values, np.flip(values), 1e9 * values, np.zeros(3)]
    return {**arrays, name: draw.choice(changed)} if draw.random() < 0.9 else {name: values}


def damaged_npz(content: bytes, draw: random.Random) -> bytes:
    """Return an archive of NumPy or MATLAB with faults in bytes or arrays."""
    if draw.random() < 0.5:
        return damaged_bytes(content, draw)
    from scipy.io import loadmat, savemat

    is_numpy, file = content.startswith(b"PK"), io.BytesIO()
    arrays = dict(np.load(io.BytesIO(content))) if is_numpy else loadmat(io.BytesIO(content))
    changed = damaged_arrays({name: arrays[name] for name in arrays if name[0] != "_"}, draw)
    (lambda: np.savez(file, **changed) if is_numpy else savemat(file, changed))()
    return file.getvalue()


def damaged_tensors(content: bytes, draw: random.Random) -> bytes:
    """Return a .safetensors file with faults in bytes, or in facts or arrays whose digest is right."""
    if draw.random() < 0.3:
        return damaged_bytes(content, draw)
    from safetensors.numpy import load, save

    header = json.loads(content[8:][: int.from_bytes(content[:8], "little")])
    facts, arrays = header["__metadata__"]["archerfish"].partition(" ")[2], load(content)
    if draw.random() < 0.5:
        facts = damaged_json(facts.encode(), draw).decode("utf-8", "replace")
    else:
        arrays = {name: np.ascontiguousarray(array) for name, array in damaged_arrays(arrays, draw).items()}
        arrays = {name: array for name, array in arrays.items() if array.dtype.kind in "fiub"}
    arrays = dict(sorted(arrays.items()))
    return bytes(save(arrays, {"archerfish": f"{storage._arrays_hash(arrays)} {facts}"}))


def make_materials(folder: Path) -> None:
    """Write one good file of each kind."""
    if (folder / "policy" / "policy.safetensors").exists():
        return
    shutil.rmtree(folder / "policy", ignore_errors=True)
    compiled.forked.append(True)  # NumPy begins sooner than JAX
    robot = shutil.copytree(ROOT / "tests" / "infantry", folder / "robot", dirs_exist_ok=True)
    if not (folder / "logs").exists():
        af.VirtualRobot.load().record(folder / "logs", parts=("landings", "shots", "timing"))
    (folder / "virtual.toml").write_bytes((folder / "logs" / "robot.toml").read_bytes())
    time_s = 0.005 * np.arange(1200)
    u = 0.05 * np.sin(2.0 * np.pi * (0.5 + time_s) * time_s) * (time_s < 4.0) + 0.05 * (time_s > 4.5)
    plant = af.PlantRecord.second_order(6.0, 0.5, delay_s=0.01, sample_period_s=0.005)
    y = simulate(plant, u[:, None])[:, 0] + 1e-4 * np.random.default_rng(0).standard_normal(len(u))
    af.Recording.from_arrays(u, y, 0.005).write_csv(folder / "axis.csv")
    np.savez(folder / "axis.npz", time_s=time_s, u=u, y=y)
    from scipy.io import savemat

    savemat(folder / "axis.mat", {"time_s": time_s, "u": u, "y": y})
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    kinds, kind = get_typestore(Stores.ROS2_HUMBLE), "std_msgs/msg/Float64"
    for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        shutil.rmtree(folder / plugin.name, ignore_errors=True)
        with Writer(folder / plugin.name, version=9, storage_plugin=plugin) as bag:
            topics = [bag.add_connection(name, kind, typestore=kinds) for name in ("/u", "/y")]
            for at, pair in enumerate(zip(u, y, strict=True)):
                for topic, value in zip(topics, pair, strict=True):
                    bag.write(topic, 10**9 + 5_000_000 * at, kinds.serialize_cdr(kinds.types[kind](value), kind))
        for file in (folder / plugin.name).glob("*.[dm][bc]*"):
            shutil.copy(file, folder / f"log{file.suffix}")
    (folder / "logs" / "logs.toml").write_text(
        '[pitch]\nfit = ["axis.csv"]\ntime = "time_s"\ninput = "-u"\noutput = "y"\nunit = "deg"\ndc_gain = 1.0\n'
        '[muzzle]\nshots = ["shots.csv"]\nlength_m = 0.16\n[sensing]\nframe = "camera"\ndegrees = false\n'
        "[limits]\npitch_deg = [-25, 10]\nyaw_deg = [-75, 75]\nmax_rate_deg_s = 690\nmax_acceleration_deg_s2 = 3400\n"
    )
    shutil.copy(folder / "axis.csv", folder / "logs")
    (shots := folder / "shots").mkdir(exist_ok=True)
    for name in ("shots.csv", "landings.csv", "tape.json", "limits.json"):
        shutil.copy(folder / "logs" / name, shots)
    (shots / "logs.toml").write_text('[muzzle]\nshots = ["shots.csv"]\nlength_m = 0.16\n')
    af.Task.load("any").save(folder / "task.toml")
    results = af.evaluate(["no-lead"], None, TASK, engagements=2, tuning="start")
    (folder / "results").mkdir(exist_ok=True)
    results.save(folder / "results")
    (folder / "study").mkdir(exist_ok=True)
    Study(results=results).save(folder / "study" / "results.json")
    loaded = af.Robot.load(robot)
    keep(entry("kalman", loaded, TASK), loaded)

    def copied(_: Any) -> None:
        """Keep the training as it is at its first checkpoint."""
        if (folder / "policy" / "checkpoint.safetensors").exists() and not (folder / "run").exists():
            shutil.copytree(folder / "policy", folder / "run", ignore=shutil.ignore_patterns("*.lock"))

    compiled.forked.clear()
    af.train(None, TASK, config={**SMALL, "checkpoint_every_s": 0}, out=folder / "policy", callback=copied)


Read = Callable[[Path, str], Any]
Case = tuple[str, Callable[[], Any]]


def folder_read(path: Path, _: str) -> Any:
    """Read what says which logs of a folder are which."""
    settings = robot_files.read_folder(path)
    return robot_files.read_limits(path, settings), robot_files.logs_of_parts(path, settings)


def axis_read(path: Path, name: str) -> Any:
    """Read a log whole."""
    return repr(af.read_log(path / name).recordings)


def robot_read(path: Path, _: str) -> Any:
    """Read a robot, and build its simulator."""
    return repr(af.make_world(af.Robot.load(path, accept_unusable=True), TASK))


def bag_read(path: Path, name: str) -> Any:
    """Read a bag whole."""
    return repr(af.read_log(path / name, inputs="/u/data", outputs="/y/data"))


def sensing_read(path: Path, _: str) -> Any:
    """Identify the sensing of three logs."""
    commands = path / "timing_commands.csv"
    return repr(af.identify_sensing(path / "timing_sweep.csv", path / "timing_plate.csv", commands=commands))


class Reader(NamedTuple):
    """What reads a file."""

    family: str  # name in the table
    folder: str  # of good files; "" where the file is alone
    names: tuple[str, ...]  # of files of which one is damaged
    damage: Callable[[bytes, random.Random], bytes]  # how
    read: Read  # called with the folder and the name
    weight: float  # how often it is drawn


CHECKPOINT, SHOTS = ("checkpoint.safetensors",), ("shots.csv",)
TIMING = ("timing_sweep.csv", "timing_plate.csv", "timing_commands.csv")
PARTS = ("robot.json", "pitch.json", "yaw.json", "muzzle.json", "sensing.json", "limits.json")
READERS = [
    Reader("log CSV", "", ("axis.csv",), damaged_text, axis_read, 8),
    Reader("log NPZ, MATLAB", "", ("axis.npz", "axis.mat"), damaged_npz, axis_read, 8),
    Reader("log bag", "", ("log.mcap", "log.db3"), damaged_bytes, bag_read, 2),
    Reader("logs.toml", "logs", ("logs.toml",), damaged_text, folder_read, 5),
    Reader("tape.json, limits.json", "shots", ("tape.json", "limits.json"), damaged_json, folder_read, 5),
    Reader("robot folder", "robot", PARTS, damaged_json, robot_read, 18),
    Reader("tuning.json", "robot", ("tuning.json",), damaged_json, lambda at, _: af.tune("kalman", at, TASK), 2),
    Reader("results", "results", ("results.json",), damaged_json, lambda at, _: repr(af.Results.load(at)), 5),
    Reader("study", "study", ("results.json",), damaged_json, lambda at, _: repr(Study.load(at)), 5),
    Reader("task TOML", "", ("task.toml",), damaged_text, lambda at, name: af.Task.load(at / name).cells(), 5),
    Reader("virtual robot TOML", "", ("virtual.toml",), damaged_text, lambda at, it: af.VirtualRobot.load(at / it), 6),
    Reader("policy", "policy", ("policy.safetensors",), damaged_tensors, lambda at, _: af.Policy.load(at), 8),
    Reader("run.json", "run", ("run.json",), damaged_json, lambda at, _: read_run(at), 6),
    Reader("training", "run", ("log.jsonl", "run.json"), damaged_text, lambda at, _: af.resume(at, callback=stop), 0.3),
    Reader("training", "run", CHECKPOINT, damaged_tensors, lambda at, _: af.resume(at, callback=stop), 0.3),
    Reader("identify_axis", "", ("axis.csv",), damaged_text, lambda at, name: repr(af.identify_axis(at / name)), 0.1),
    Reader("identify_muzzle", "shots", SHOTS, damaged_text, lambda at, name: repr(af.identify_muzzle(at / name)), 0.1),
    Reader("identify_robot", "shots", SHOTS, damaged_text, lambda at, _: repr(af.identify_robot(at)), 0.1),
    Reader("identify_sensing", "logs", TIMING, damaged_text, sensing_read, 0.1),
]  # fmt: skip


def read_cases(work: Path, place: Path, draw: random.Random) -> Case:
    """Return a file that is damaged, and what reads it."""
    readers = [reader for reader in READERS if compiled.has_jax() or reader.family not in ("training", "checkpoint")]
    reader = draw.choices(readers, [reader.weight for reader in readers])[0]
    family, folder, names, damage, read, _ = reader
    name = draw.choice(names)
    given = place / "given"
    if folder:
        shutil.copytree(work / folder, given)
    given.mkdir(exist_ok=True)
    content = damage((work / folder / name).read_bytes(), draw)
    (given / name).write_bytes(content)
    return family, lambda: read(given, name)


@functools.cache
def odd_values(work: Path) -> list[Any]:
    """Return arguments that hardly anything takes."""
    arrays = [np.full(3, np.nan), np.zeros((0, 3)), np.zeros((2, 3, 4)), np.array("x"), np.array([object()])]
    paths = [work, work / "absent", work / "axis.csv", str(work / "robot"), "x" * 5000, "\0", "../..", ""]
    odd = [b"x", object(), math.inf, -2.5, 2**63, 1e-300, iter(()), print, int, Exception, {"a": 1}, {1: 2}, ["kalman"]]
    odd += [
        [[1, 2], [3]],
        set(),
        1j,
        np.float32(2),
        np.int64(3),
        ("kalman", "kalman"),
        lambda *_: None,
        "paper",
        [None],
    ]
    return [*TESTS["ODD"], *arrays, *paths, *odd]


@functools.cache
def good_robots(work: Path) -> tuple[af.VirtualRobot, af.Robot]:
    """Return a virtual robot, and another one's records."""
    return af.VirtualRobot.load(), af.Robot.load(work / "robot")


def verbs(work: Path, place: Path) -> list[tuple[Callable[..., Any], dict[str, Any], float]]:
    """Return public functions with what they need to be quick, and how often each is drawn."""
    shooting = {"robot": work / "robot", "task": TASK, "engagements": 2, "tuning": "start"}
    logs, (virtual, robot) = work / "logs", good_robots(work)
    training = {"task": TASK, "config": SMALL, "steps": 400, "out": place / "out", "callback": stop}
    sensing = {"sweep": logs / "timing_sweep.csv", "detections": logs / "timing_plate.csv"}
    fields = {name: getattr(robot, name) for name in robot.__struct_fields__}
    return [
        (af.evaluate, {"controllers": ["no-lead"], **shooting}, 2),
        (af.rollout, {"controller": "no-lead", **shooting}, 2),
        (af.train, training, 1),
        (af.tune, {"controller": "kalman", "task": TASK}, 1),
        (af.export, {"controller": "no-lead", "path": place / "x.c", "task": TASK, "tuning": "start"}, 1),
        (af.identify_axis, {"logs": work / "axis.csv", "order": 2, "max_delay": 9, "feedthrough": False}, 2),
        (af.identify_muzzle, {"shots": logs / "shots.csv", "height_m": 0.45}, 2),
        (af.identify_sensing, sensing, 1),
        (af.identify_robot, {"folder": work / "shots", "out": place / "out"}, 1),
        (af.excite, {"axis": "yaw", "kinds": ("step",), "validation": False}, 1),
        (af.read_log, {"source": work / "axis.csv"}, 8),
        (af.Recording.from_arrays, {"u": np.sin(np.arange(99.0)), "y": np.arange(99.0), "period_s": 0.01}, 6),
        (af.make_world, {"robot": work / "robot", "task": TASK}, 4),
        (af.make_environment, {"robot": work / "robot", "task": TASK, "config": SMALL}, 4),
        (virtual.record, {"folder": place / "out", "parts": ("landings",)}, 1),
        (af.VirtualRobot.load, {"robot": "worn"}, 2),
        (af.Robot, fields, 6),
        (af.Task, {name: getattr(TASK, name) for name in TASK.__struct_fields__}, 8),
        (af.TrainConfig, {name: getattr(af.TrainConfig(), name) for name in af.TrainConfig.__struct_fields__}, 4),
        (af.PlantRecord.from_state_space, {"A": [[0.5]], "B": [[1.0]], "C": [[1.0]], "D": [[0.0]], "dt": 0.01}, 6),
        (af.PlantRecord.second_order, {"natural_hz": 5.0, "damping": 0.5, "sample_period_s": 0.01}, 6),
        (af.Results.load, {"path": work / "results"}, 2),
        (af.Policy.load, {"path": work / "policy"}, 2),
        (af.Robot.load, {"folder": work / "robot"}, 2),
        (af.Task.of, {"task": "any"}, 4),
        (robot.save, {"folder": place / "out"}, 2),
        (af.resume, {"folder": work / "policy", "callback": stop}, 2),
    ]


def argument_cases(work: Path, place: Path, draw: random.Random) -> Case:
    """Return a call of which one or two arguments are odd."""
    every = verbs(work, place)
    verb, given, _ = draw.choices(every, [weight for *_, weight in every])[0]
    names = [name for name, each in inspect.signature(verb).parameters.items() if each.kind not in (2, 4)]
    odd = {
        name: draw.choice(odd_values(work)) for name in draw.sample(names, min(draw.choice((1, 1, 1, 2)), len(names)))
    }
    return verb.__qualname__, lambda: repr(verb(**{**given, **odd}))


FAULTS = [
    "raise ValueError('a\\nb')", "raise SystemExit(3)", "exit()", "return None", "return 0.0", "return 1 / 0",
    "import absent_module", "print('x' * 100)", "raise KeyError", "raise StopIteration", "raise MemoryError",
    "return object()", "return 'text'", "return [1, [2]]", "yield 1", "(", "assert False", "return float('nan')",
    "import numpy; return numpy.zeros((7, 7))", "f = lambda: f(); f()", "raise af",
    "import warnings; warnings.warn('x')",
    "class E(Exception): __str__ = lambda self: 1 / 0\n{}raise E", "raise ExceptionGroup('x', [ValueError()])",
]  # fmt: skip
CODE = {"two_frames.py": "two_frames", "departure.py": "departure", "late_camera.py": "late_camera"}
CODE["rigid_gimbal.py"] = "gimbal"


def code_cases(_: Path, place: Path, draw: random.Random) -> Case:
    """Return code of a user's own with a fault in one of its functions, and what uses it."""
    file, name = draw.choice([*CODE.items()])
    lines = (ROOT / "examples" / file).read_text().splitlines()
    at = draw.choice(
        [number for number, line in enumerate(lines) if "def " in line or line.strip().startswith("return")]
    )
    indent = re.match(" *", lines[at])[0] + "    " * ("def " in lines[at])  # type: ignore[index]
    lines.insert(at + ("def " in lines[at]), indent + draw.choice(FAULTS).format(indent))
    (place / file).write_text("\n".join([*lines, ""]))
    spec, controller = f"{place / file}:{name}", "no-lead"
    named: dict[str, Any] = {"tuning": "start", "engagements": 2}
    return f"code: {name}", {
        "two_frames": lambda: af.evaluate(spec, None, TASK, **named),
        "departure": lambda: af.evaluate(controller, None, af.Task.load(spec).replace(ranges_m=((2, 3),)), **named),
        "late_camera": lambda: af.evaluate(controller, None, TASK, world=spec, **named),
        "gimbal": lambda: af.make_world(af.Robot.paper().replace(pitch=spec), TASK),
    }[name]


def state_of(*folders: Path) -> dict[str, tuple[int, int, int]]:
    """Return size, time and number of each file."""
    files = (file for folder in folders for file in folder.rglob("*") if file.is_file() and file.suffix != ".lock")
    return {str(file): (file.stat().st_size, file.stat().st_mtime_ns, file.stat().st_ino) for file in files}


def memory(name: str) -> int:
    """Return a memory of this process [bytes]."""
    return 1024 * int(re.search(rf"{name}:\s*(\d+)", Path("/proc/self/status").read_text())[1])  # type: ignore[index]


def watched(call: Callable[[], Any], work: Path, place: Path, *, continues: bool) -> Ended:
    """Call a function under watch of time, memory and files."""
    before, begun, ended = state_of(work, place), time.process_time(), Ended("accepted")
    Path("/proc/self/clear_refs").write_text("5")
    base = memory("VmRSS")

    def slow(*_: Any) -> None:
        raise TooSlowError

    for number in (signal.SIGPROF, signal.SIGVTALRM):
        signal.signal(number, slow)
    signal.setitimer(signal.ITIMER_PROF, MOST_S)
    try:
        with (
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
            warnings.catch_warnings(),
        ):
            warnings.simplefilter("ignore")
            call()
    except af.InputError as error:
        text = str(error)
        ended = Ended("refused", text) if text.isprintable() else Ended("wrong", f"not one printable line: {text!r}")
    except EnoughError:
        pass
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        frames = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
        ended = Ended("wrong", f"{type(error).__name__} in {' '.join(frames[-4:])}: {ascii(error)[:150]}")
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    spent, peak, after = time.process_time() - begun, memory("VmHWM") - base, state_of(work, place)
    lost = [name for name in before if after.get(name) != before[name] and not name.endswith("tuning.json")]
    new = [name for name in after if name not in before and (ended.verdict == "refused" or ".unfinished" in name)]
    if continues:  # a training that continues is written on
        lost = []
    if ended.verdict != "wrong" and (lost or [name for name in new if "tuning.json" not in name]):
        return Ended("wrong", f"{ended.verdict}, but lost {lost}, left {new}")
    if spent > MOST_S or peak > MOST_BYTES:
        return Ended("wrong", f"{ended.verdict} after {spent:.1f} s and {peak / 1e6:.0f} MB: {ended.text}")
    return ended


COMMANDS = {  # with small figures, and which are too long but for signals
    "record": "record --parts landings --out {out}",
    "identify": "identify {work}/shots --out {out}",
    "identify axis": "identify axis yaw {work}/axis.csv --out {out}",
    "identify muzzle": "identify muzzle {work}/logs/shots.csv --height-m 0.45 --out {out}",
    "identify sensing": "identify sensing {work}/logs/timing_sweep.csv {work}/logs/timing_plate.csv --out {out}",
    "excite": "excite yaw --kinds step --no-validation --duration-s 2 --out {out}",
    "train": "train {robot} --steps 2000 --set gradient.environments=8 gradient.hidden=4 --out {out}",
    "resume": "train --resume {place}/run",
    "evaluate": "evaluate {robot} --task static --controllers no-lead --tuning start --engagements 2 --out {out}",
    "view": "view {robot} --task static --controller no-lead --engagements 2 --export {out}.html",
    "page": "view --task static --controller no-lead --engagements 2 --port 0",
    "export": "export {robot} --controller no-lead --tuning start --out {out}.c",
    "report": "report {work}/results --out {out}.html",
    "transfer": "transfer --quick --out {out}",
    "reproduce": "reproduce --quick --out {out}",
}
ENDLESS = ("page", "transfer", "reproduce")
WORDS = [
    "", "-1", "nan", "1e999", "x" * 300, "é", "\udcff", "--", "--help-me", "{}", "[1", "0", "1e9", "../..", "=", "a=b",
]  # fmt: skip
PLACES = [
    "/dev/null", "/dev/zero", "/dev/full", "/dev/stdin", "/proc/self/mem", "/proc/x", "{full}/out", "{place}/fifo",
    "{place}/keep.txt", "{place}", "{place}/absent/x", "{place}/loop", "{place}/a\nb", "{place}/\udcff",
    "{place}/" + "y" * 300,
]  # fmt: skip


def command_case(work: Path, place: Path, draw: random.Random) -> tuple[str, list[str], str]:
    """Return family, words and surroundings of a command."""
    family = draw.choice(("option", "option", "path", "path", "pipe", "full", "signal", "signal", "encoding"))
    name = draw.choice([name for name in COMMANDS if family == "signal" or name not in ENDLESS])
    full, out = work / "full", place / "out"
    shown = {"work": work, "place": place, "out": out, "robot": work / "robot"}
    words = COMMANDS[name].format(**shown).split()
    kind = family
    if family == "option":
        at = draw.randrange(1, len(words))
        fault = draw.choice(WORDS)
        words[at : at + draw.choice((0, 1, 1, 1))] = [fault] * draw.choice((0, 1, 1, 1, 2))
    if family == "path":
        paths = [at for at, word in enumerate(words) if word.startswith("/")]
        words[draw.choice(paths)] = draw.choice(PLACES).replace("{place}", str(place)).replace("{full}", str(full))
    if family == "signal":
        kind = draw.choice(("SIGINT", "SIGTERM"))
    if family == "full":
        words = [word.replace(str(place), str(full)) for word in words] if draw.random() < 0.7 else words
        kind = "full" if str(full) in " ".join(words) else "/dev/full"
    if family == "encoding":
        kind, words = (
            draw.choice(("ascii", "gbk", "cp1252", "utf-16")),
            draw.choice((words, [*words[:-1], "σ²"], [name, "--help"])),
        )
    return family, words, kind


def cpu_s(child: int) -> float:
    """Return the processor time of a process [s]."""
    fields = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def be_command(words: list[str], stdout: int, stderr: int, environment: dict[str, str], place: Path) -> NoReturn:
    """Be a process of the command line: the same but for its imports, which the fuzzer has done."""
    for source, target in ((os.open(os.devnull, os.O_RDONLY), 0), (stdout, 1), (stderr, 2)):
        os.dup2(source, target)
    encoding = environment.get("PYTHONIOENCODING", "utf-8")
    sys.stdout = io.TextIOWrapper(io.FileIO(1, "w"), encoding)
    sys.stderr = io.TextIOWrapper(io.FileIO(2, "w"), encoding, "backslashreplace", line_buffering=True)
    os.environ.update(environment)
    os.chdir(place)
    if words[0] in ("train", "transfer", "reproduce"):
        compiled.forked.clear()
    sys.argv, status = ["archerfish", *words], 1
    try:
        program()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 0
    except BaseException:
        traceback.print_exc()
    with contextlib.suppress(OSError):
        sys.stdout.flush()
    os._exit(status)


def run_command(work: Path, place: Path, draw: random.Random) -> tuple[str, str, Ended]:
    """Run a command in its surroundings, and judge how it ended."""
    family, words, kind = command_case(work, place, draw)
    os.mkfifo(place / "fifo")
    (place / "loop").symlink_to(place / "loop")
    shutil.copytree(work / "run", place / "run")
    full, mounted = work / "full", kind == "full" or str(work / "full") in " ".join(words)
    full.mkdir(exist_ok=True)
    if mounted:
        subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", full], check=True)
    (place / "out").mkdir()
    (place / "out" / "keep.txt").write_text("kept")
    before, environment = state_of(work, place), dict[str, str]()
    environment |= {"PYTHONIOENCODING": kind} if family == "encoding" else {}
    said = (place / "stderr").open("w+b")
    reading, writing = os.pipe()
    os.close(reading)
    output = {"/dev/full": "/dev/full"}.get(kind, os.devnull)
    stdout = writing if kind == "pipe" else os.open(output, os.O_WRONLY)
    number, begun = getattr(signal, kind, None), time.monotonic()
    child = os.fork()
    if not child:
        be_command(words, stdout, said.fileno(), environment, place)
    os.close(writing)
    due_s = draw.uniform(0.0, 12.0 if words[0] in ENDLESS or "--port" in words else 3.0)
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        time.sleep(0.02)
        if number and max(cpu_s(child), 0.1 * (time.monotonic() - begun)) > due_s:  # a page waits
            os.kill(child, number)
            due_s = math.inf
        if cpu_s(child) > LONGEST_S or time.monotonic() - begun > 5 * LONGEST_S:
            os.kill(child, signal.SIGKILL)
    _, status, used = ended
    status = os.waitstatus_to_exitcode(status)
    said.seek(0)
    encoding = kind if family == "encoding" else "utf-8"
    lines = said.read().decode(encoding, errors="replace").splitlines()
    said.close()
    own = [line for line in lines if not PROGRESS.fullmatch(line)]
    text, spent, wall = " | ".join(own)[-300:], used.ru_utime + used.ru_stime, time.monotonic() - begun
    faults = []
    expected = {0: 0, 2: 1, **dict.fromkeys(ALLOWED.get(number, ()), SAID_OF_A_STOP)}
    expected |= {1: 0, -signal.SIGPIPE: 0} if kind == "pipe" else {}
    if status not in expected:
        faults.append(f"status {status} after {wall:.0f} s")
    elif len(own) > expected[status] or (status == 2 and not (own and own[0].startswith("archerfish: "))):
        faults.append(f"status {status} with {len(own)} lines")
    most_bytes = TRAINING_BYTES if words[0] in TRAINING else MOST_BYTES + IMPORTS_BYTES
    if used.ru_maxrss * 1024 > most_bytes:
        faults.append(f"{used.ru_maxrss / 1024:.0f} MB")
    if status == 2 and spent > MOST_S + IMPORTS_S:
        faults.append(f"refused after {spent:.0f} s")
    after, own_run = state_of(work, place), str(place / "run")
    faults += [f"lost {file}" for file in before if after.get(file) != before[file] and not file.startswith(own_run)]
    faults += [f"left {file}" for file in [*place.rglob(".unfinished*"), *full.rglob(".unfinished*")]]
    if status == 2:
        kept = (own_run, str(place / "stderr"))
        faults += [f"left {file}" for file in after if file not in before and not file.startswith(kept)]
    if mounted:
        subprocess.run(["umount", full], check=True)
    shown = shlex.join(words).replace(str(place), "PLACE").replace(str(work), "WORK")
    verdict = "wrong" if faults else "accepted" if status == 0 else "refused"
    return f"command: {family}", f"{shown} ({kind})", Ended(verdict, f"{'; '.join(faults)}: {text}" if faults else text)


def run_all(work: Path, options: argparse.Namespace) -> Iterator[tuple[str, str, Ended]]:
    """Yield family, case and end of all."""
    sources = {"file": read_cases, "argument": argument_cases, "code": code_cases}
    shares = {"file": 0.8, "argument": 0.17, "code": 0.03}
    for number in range(options.functions + options.commands):
        draw = random.Random(f"{options.seed} {number}")
        with tempfile.TemporaryDirectory(dir=None) as name:
            place = Path(name)
            (place / "keep.txt").write_text("kept")
            if number < options.commands:
                family, shown, ended = run_command(work, place, draw)
            else:
                if options.jax:
                    compiled.forked.clear()
                source = draw.choices([*shares], [*shares.values()])[0]
                family, call = sources[source](work, place, draw)
                if options.only not in f"{source}: {family}":
                    continue
                shown = f"case {number}"
                ended = watched(call, work, place, continues=family == "training")
                family = family if source != "argument" else f"argument of {family}"
            yield family, shown, ended._replace(text=ended.text.replace(str(place), "PLACE").replace(str(work), "WORK"))


def main() -> None:
    """Damage, call, count, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--functions", type=int, default=5000)
    parser.add_argument("--commands", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--work", type=Path, help="folder of good files, which is kept for the next run")
    parser.add_argument("--jax", action=argparse.BooleanOptionalAction, default=True, help="functions have JAX")
    parser.add_argument("--make", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--only", default="", help="functions of families that have this word alone")
    options = parser.parse_args()
    counts, wrong, done = dict[str, Counter[str]](), dict[str, list[str]](), 0
    if options.make:
        make_materials(options.make)
        return
    with tempfile.TemporaryDirectory() as name:
        work = options.work or Path(name) / "work"
        os.environ["ARCHERFISH_CACHE"] = str(work / "cache")
        work.mkdir(exist_ok=True)
        if not (work / "policy" / "policy.safetensors").exists():
            # With JAX, this process could not be forked.
            subprocess.run([sys.executable, __file__, "--make", work], check=True)
        compiled.forked.append(True)  # NumPy begins sooner than JAX
        for module, _ in command_line.COMMANDS.values() if options.commands else ():
            importlib.import_module(module)
        importlib.import_module("archerfish.evaluation.tuning_search").rates = lambda *_: lambda _: 0.5  # type: ignore[attr-defined]
        limit = memory("VmSize") + 8 * 10**9  # an input that asks for more gets a MemoryError
        os.chdir(name)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with contextlib.suppress(KeyboardInterrupt):  # what was found until then is printed and written
            for done, (family, shown, ended) in enumerate(run_all(work, options), 1):
                resource.setrlimit(resource.RLIMIT_AS, (limit if done >= options.commands else -1, -1))
                counts.setdefault(family, Counter())[ended.verdict] += 1
                if ended.verdict == "wrong":
                    wrong.setdefault(family, []).append(f"{shown}: {ended.text}")
                    print(f"{family}: {shown}: {ended.text}", flush=True)
                if done % 100 == 0:
                    print(f"{done} cases, {sum(map(len, wrong.values()))} wrong", file=sys.stderr, flush=True)
    print(f"{'family':<40} accepted  refused    wrong")
    for family in sorted(counts):
        print(
            f"{family:<40}" + "".join(f"{counts[family][verdict]:>9}" for verdict in ("accepted", "refused", "wrong"))
        )
        for text in wrong.get(family, [])[:3]:
            print(f"    {text[:300]}")
    chosen = {name: getattr(options, name) for name in ("functions", "commands", "seed", "jax")}
    conditions = {"commit": code_commit(), "versions": library_versions(), "done": done, **chosen}
    first = {family: texts[:5] for family, texts in wrong.items()}
    if not options.only:
        found = {"conditions": conditions, "families": counts, "wrong": first}
        RESULT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
