"""Ctrl-C, as a terminal sends it: to every process of the group at once."""

import os
import re
import signal
import subprocess
import time
from pathlib import Path

import pytest

PATIENCE_S = 120.0
"""Nothing here takes a tenth of it; a slow machine may."""


def read_until(process: subprocess.Popen[bytes], sign: bytes) -> bytes:
    """Read what a process says on standard error until a sign appears in it."""
    said = b""
    while sign not in said:
        more = os.read(process.stderr.fileno(), 4096)
        assert more, said.decode()
        said += more
    return said


def children_of(process: subprocess.Popen[bytes]) -> list[int]:
    """Return the processes that a process has started."""
    listing = Path(f"/proc/{process.pid}/task/{process.pid}/children")
    if not listing.exists():
        pytest.skip("needs Linux to list a process' children")
    return [int(each) for each in listing.read_text().split()]


def is_alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits to be collected does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def all_end(pids: list[int]) -> bool:
    """Wait until processes have ended."""
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        if not any(map(is_alive, pids)):
            return True
        time.sleep(0.05)
    return False


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (
            "train --target paper --ppo.environments 8 --ppo.rollout 8 --ppo.hidden 8",
            " before the first checkpoint; nothing was kept",
        ),
        ("reproduce --quick --workers 2", "; what was unfinished is discarded"),
    ],
    ids=["train before its first checkpoint", "reproduce --quick"],
)
def test_ctrl_c_in_training_ends_in_one_line_and_leaves_nothing(started, tmp_path, words, why):
    process = started(*words.split(), "--out", "runs/first", "--json", "facts/facts.json")
    said = read_until(process, b"training")
    workers = children_of(process)
    os.killpg(process.pid, signal.SIGINT)
    out, rest = process.communicate(timeout=PATIENCE_S)
    plain = re.sub(r"\x1b\[[?\d;]*[a-zA-Z]", "", (said + rest).decode())
    told = [line for line in plain.splitlines() if "━" not in line and line.strip()]
    assert process.returncode == 130
    assert told == [f"archerfish: interrupted{why}"]
    assert out == b""
    assert list(tmp_path.iterdir()) == []
    assert all_end(workers)


def test_workers_end_when_their_parent_is_killed(started):
    process = started("reproduce", "--quick", "--workers", "2")
    read_until(process, b"identifying")
    time.sleep(1.0)
    workers = children_of(process)
    assert len(workers) >= 2
    process.kill()
    assert all_end(workers)
