"""The environments that the tools run in, made on demand and kept in a cache folder ($ARCHERFISH_PEERS)."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from peers.roster import Tool

FOLDER = Path(__file__).parent
CACHE = Path(os.environ.get("ARCHERFISH_PEERS", Path.home() / ".cache" / "archerfish" / "peers"))
PYTHON = "python3.11"
"""The newest interpreter that all pinned packages support."""
INSTALL_LIMIT_S = 900


class NotRunError(Exception):
    """Why a tool can't be run here."""


def command(tool: Tool) -> list[str]:
    """Return how to start a tool's adapter, its environment being made first where there is none.

    Raises:
      NotRunError: if the tool can't be installed, or its program is not on the PATH.
    """
    adapter = str(FOLDER / tool.adapter)
    if tool.requirements:
        return [str(_environment(tool)), adapter]
    if tool.adapter.endswith(".py"):
        return [sys.executable, adapter]
    program = shutil.which("octave-cli")
    if program is None:
        raise NotRunError("octave-cli is not on the PATH (Debian, Ubuntu: apt install octave octave-control)")
    return [program, "--no-gui", "--no-history", adapter]


def version(tool: Tool) -> str:
    """Return the version of an installed tool, as its requirements or the program itself state it."""
    if tool.requirements:
        return (FOLDER / tool.requirements).read_text().split()[0]
    if tool.adapter.endswith(".py"):
        return "this commit"
    query = 'p = pkg ("list", "control"); printf ("Octave %s, control %s", version (), p{1}.version)'
    return _run(["octave-cli", "--no-gui", "--eval", query], 60)


def _environment(tool: Tool) -> Path:
    """Return the interpreter of a tool's environment; a stamp, written last, tells a whole one from a half-made one."""
    folder, requirements = CACHE / Path(tool.requirements).stem, FOLDER / tool.requirements
    stamp, interpreter = folder / "requirements.txt", folder / "bin" / "python"
    if stamp.is_file() and stamp.read_text() == requirements.read_text():
        return interpreter
    print(f"making an environment for {tool.name} in {folder}", flush=True)
    _run([shutil.which(PYTHON) or sys.executable, "-m", "venv", "--clear", str(folder)], INSTALL_LIMIT_S)
    _run([str(interpreter), "-m", "pip", "install", "--quiet", "-r", str(requirements)], INSTALL_LIMIT_S)
    shutil.copyfile(requirements, stamp)
    return interpreter


def _run(words: list[str], limit_s: float) -> str:
    try:
        return subprocess.run(words, check=True, capture_output=True, text=True, timeout=limit_s).stdout
    except subprocess.TimeoutExpired as error:
        raise NotRunError(f"{' '.join(words[:4])} took more than {limit_s:g} s") from error
    except (OSError, subprocess.CalledProcessError) as error:
        said = getattr(error, "stderr", "") or str(error)
        raise NotRunError(f"{' '.join(words[:4])} failed: {said.strip().splitlines()[-1]}") from error
