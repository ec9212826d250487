"""Trainings that are ended at random moments: whether the weights are those of an unbroken training, to the bit.

`python benchmarks/kills.py` begins trainings of both trainers again and again, sends SIGKILL at a random moment and
continues them, until 50 kills have met a living process; then 10 SIGTERMs, 5 checkpoints that are damaged or cut, a
second writer and a full disk (a file system of 1 MB, where the user may mount one; else a limit of the file size).
Each training must end with the weights of the unbroken one. Writes results/kills.json.
"""

import argparse
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

RESULT = Path(__file__).parent / "results" / "kills.json"
SETTINGS = {
    name: f"--trainer {name} --steps {steps} --set {name}.environments=64 {name}.hidden=32 checkpoint_every_s=0"
    for name, steps in (("gradient", 200_000), ("ppo", 300_000))
}


def start(words: str, **options: Any) -> subprocess.Popen[str]:
    """Begin a command."""
    command = [sys.executable, "-m", "archerfish", *words.split()]
    pipes: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen(command, **pipes, **options)


def finish(words: str) -> None:
    """Run a command to its end."""
    process = start(words)
    faults = process.communicate()[1]
    if process.returncode:
        raise SystemExit(f"{words}: {faults}")


def weights(folder: Path) -> dict[str, bytes]:
    """Return the arrays of a policy's file, byte for byte."""
    from safetensors.numpy import load_file

    return {name: array.tobytes() for name, array in load_file(folder / "policy.safetensors").items()}


def words_for(out: Path, trainer: str) -> str:
    """Return the command that begins a training in a folder, or continues the one that is there."""
    if (out / "run.json").exists():
        return f"train --resume {out}"
    shutil.rmtree(out, ignore_errors=True)  # killed before anything was written
    return f"train --task paper {SETTINGS[trainer]} --seed 3 --out {out}"


def kill_until_finished(out: Path, trainer: str, number: int, kills: int, longest_s: float) -> int:
    """End a training by signals, at most so often, at random moments of the time that it takes; return how often."""
    met = 0
    while not (out / "policy.safetensors").exists():
        process = start(words_for(out, trainer))
        if met < kills:
            time.sleep(random.uniform(0.0, longest_s))
            process.send_signal(number)
            met += process.wait() in (-number, 128 + number)
        elif process.wait():
            raise SystemExit(f"{trainer}: {process.communicate()[1]}")
    return met


def main() -> None:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=50)
    kills, found = parser.parse_args().kills, dict[str, dict[str, Any]]()
    random.seed(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for trainer in SETTINGS:
            whole = folder / trainer
            begun = time.monotonic()
            finish(words_for(whole, trainer))
            longest, expected = time.monotonic() - begun, weights(whole)
            begun = time.monotonic()
            finish(words_for(folder / "again", trainer))  # with kept programs
            longest = min(longest, time.monotonic() - begun)
            shutil.rmtree(folder / "again")
            row: dict[str, Any] = {
                "seconds": round(longest, 1),
                "kills": 0,
                "terms": 0,
                "damaged": 0,
                "equal": 0,
                "trainings": 0,
            }
            found[trainer] = row

            def judge(out: Path, row: dict[str, Any] = row, expected: Any = expected) -> None:
                row["trainings"] += 1
                row["equal"] += weights(out) == expected
                shutil.rmtree(out)

            for kind, number, wanted in (("kills", signal.SIGKILL, kills // 2), ("terms", signal.SIGTERM, kills // 10)):
                while row[kind] < wanted:
                    out = folder / f"{trainer}-{kind}"
                    row[kind] += kill_until_finished(out, trainer, number, min(8, wanted - row[kind]), longest)
                    judge(out)
            for place in range(3 if trainer == "ppo" else 2):
                out = folder / f"{trainer}-damaged"
                while not (out / "checkpoint.previous.safetensors").exists():
                    shutil.rmtree(out, ignore_errors=True)
                    process = start(words_for(out, trainer))
                    while process.poll() is None and not (out / "checkpoint.previous.safetensors").exists():
                        time.sleep(0.02)
                    process.kill()
                    process.wait()
                checkpoint = out / "checkpoint.safetensors"
                content = bytearray(checkpoint.read_bytes() if checkpoint.exists() else b"")
                if place % 2:
                    content = content[: len(content) // 2]
                elif content:
                    content[len(content) * 3 // 4] ^= 1
                checkpoint.write_bytes(bytes(content))
                process = start(words_for(out, trainer))
                said = process.communicate()[1]
                row["damaged"] += process.returncode == 0 and "checkpoint before" in said
                judge(out)
            print(trainer, row, flush=True)
        out = folder / "held"
        first = start(words_for(out, "ppo"))
        while not (out / "run.json").exists():
            time.sleep(0.05)
        second = start(words_for(out, "ppo"))
        found["second writer"] = {"refused": second.wait() == 2, "says": second.communicate()[1].strip()}
        first.wait()
        out = folder / "full"

        def small() -> None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

        environment = {**os.environ, "JAX_ENABLE_COMPILATION_CACHE": "false"}
        process = start(words_for(out, "ppo"), preexec_fn=small, env=environment)
        said = process.communicate()[1].strip()
        finish(words_for(out, "ppo"))
        found["full disk"] = {
            "status": process.returncode,
            "says": said,
            "continued": (out / "policy.safetensors").exists(),
        }
    print(json.dumps(found, indent=1))
    if kills == 50:
        RESULT.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
