"""The environment of the libraries that trainings are compared with, made when it is first needed and then kept."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PINNED = Path(__file__).with_name("peers.txt")
"""Its packages, and what the second edition needs itself."""
FOLDER = Path(os.environ.get("ARCHERFISH_PEERS", Path.home() / ".cache" / "archerfish" / "peers")) / "second_edition"
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
