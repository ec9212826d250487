"""The environment of the libraries that trainings are compared with, made when it is first needed and then kept."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PINNED = Path(__file__).with_name("peers.txt")
"""Its packages, and what Archerfish needs itself."""
FOLDER = Path(os.environ.get("ARCHERFISH_PEERS", Path.home() / ".cache" / "archerfish" / "peers")) / "trainings"
SURROUNDINGS = {**os.environ, "JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT / "src"), "TF_CPP_MIN_LOG_LEVEL": "3"}
"""Environment variables of every process that is measured."""


def interpreter(given: Path | None = None) -> str:
    """Return the Python that has the peers; what is given, or that of a virtual environment of our own."""
    if given is not None:
        return str(given)
    python, stamp = FOLDER / "bin" / "python", FOLDER / PINNED.name
    if not stamp.is_file() or stamp.read_text() != PINNED.read_text():
        print(f"installing Brax and Stable-Baselines3 in {FOLDER}", flush=True)
        subprocess.run([sys.executable, "-m", "venv", "--clear", str(FOLDER)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", "-r", str(PINNED)], check=True)
        shutil.copyfile(PINNED, stamp)  # last, so that half an installation is made again
    return str(python)


def versions(python: str) -> dict[str, str]:
    """Return the versions of the libraries that a Python has of those that matter."""
    code = """import importlib.metadata as m, json
print(json.dumps({d.name: d.version for d in m.distributions() if d.name in
      ("jax", "numpy", "torch", "brax", "stable_baselines3", "stable-baselines3")}))"""
    found: dict[str, str] = json.loads(subprocess.check_output([python, "-c", code], text=True))
    return found
