import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archerfish.cli.main import main
from archerfish.identification.axis.state_space import simulate
from archerfish.records.plant import PlantRecord, write_plant
from archerfish.records.policy import PolicyRecord, write_policy
from archerfish.records.recording import make_recording, write_recording_csv

PLANT = PlantRecord(
    np.array([[0.9, 0.2], [-0.2, 0.9]]), np.array([[0.1], [0.2]]), np.array([[1.0, 0.5]]), np.zeros((1, 1)), 1, 0.01
)


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    """Two logs of one axis with 2 % noise, train.csv and test.csv."""
    rng = np.random.default_rng(0)
    paths = []
    for name in ("train.csv", "test.csv"):
        inputs = rng.standard_normal((400, 1))
        outputs = simulate(PLANT, inputs)
        outputs += 0.02 * outputs.std() * rng.standard_normal(outputs.shape)
        paths.append(tmp_path / name)
        write_recording_csv(paths[-1], make_recording(inputs, outputs, 0.01))
    return paths


@pytest.fixture
def records(tmp_path: Path) -> Path:
    """Folder with a plant record (plant.json) and an untrained policy (policy.json)."""
    rng = np.random.default_rng(0)
    write_plant(tmp_path / "plant.json", PLANT)
    policy = PolicyRecord(
        observation="paper",
        frames=0,
        weights=tuple(rng.normal(size=size).astype(np.float32) for size in ((6, 4), (4, 2))),
        biases=tuple(np.zeros(size, np.float32) for size in (4, 2)),
        mean=np.zeros(6, np.float32),
        variance=np.ones(6, np.float32),
        action_scale=np.full(2, 0.1, np.float32),
        braking=np.full(2, 0.03, np.float32),
        muzzle={"speed": 18.0, "drag": 0.019, "length": 0.0, "pitch_offset": 0.0, "yaw_offset": 0.0},
        period_s=0.02,
        command_limit="gate",
        training={"seed": 3},
    )
    write_policy(tmp_path / "policy.json", policy)
    return tmp_path


@pytest.fixture
def command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple[int, str, str]]:
    """Run a command line in the temporary folder; return exit status, standard output and standard error."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")

    def run(*words: Any) -> tuple[int, str, str]:
        try:
            main([str(word) for word in words])
            status: Any = 0
        except SystemExit as ended:
            status = ended.code or 0
        told = capsys.readouterr()
        return status, told.out, told.err

    return run


def everything_in(folder: Path) -> dict[str, bytes | None]:
    """Return path → content of every file and folder below a folder."""
    paths = sorted(folder.rglob("*"))
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in paths}


@pytest.fixture
def refused(command: Callable[..., tuple[int, str, str]], tmp_path: Path) -> Callable[..., str]:
    """Run a command line that must fail in one line, with status 2, and leave the folder as it was; return the line."""

    def run(*words: Any) -> str:
        before = everything_in(tmp_path)
        status, out, err = command(*words)
        assert status == 2, err
        assert out == ""
        assert [line[:19] for line in err.splitlines() if "━" not in line] == ["archerfish: error: "], err
        assert everything_in(tmp_path) == before
        return err

    return run


@pytest.fixture
def edited(records: Path) -> Callable[..., Path]:
    """Change fields of the policy's JSON, and return the file."""

    def edit(**changes: Any) -> Path:
        path = records / "edited.json"
        path.with_suffix(".safetensors").write_bytes((records / "policy.safetensors").read_bytes())
        path.write_text(json.dumps(json.loads((records / "policy.json").read_text()) | changes))
        return path

    return edit


# A shell that runs the tests in the background lets them, and all that they start, ignore Ctrl-C.
PROGRAM = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from archerfish.cli.main import program
program()
"""


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Callable[..., subprocess.Popen[bytes]]]:
    """Start a command line in a process group of its own, whose progress shows as in a terminal."""
    processes = []

    def start(*words: str) -> subprocess.Popen[bytes]:
        process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *words],
            cwd=tmp_path,
            env={**os.environ, "FORCE_COLOR": "1", "COLUMNS": "80"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        processes.append(process)
        return process

    yield start
    for process in processes:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
