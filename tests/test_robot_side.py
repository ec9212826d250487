"""What runs on a robot, and what identifies one, needs no JAX: a plain installation is enough."""

import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
PACKAGES = (
    "records",
    "paper",
    "figures",
    "dynamics",
    "targets",
    "sensing",
    "identification",
    "controllers",
    "deployment",
)
EXTRAS = ("jax", "jaxlib", "optax", "gymnasium", "mujoco", "optuna", "ray", "viser", "onnx", "onnxruntime")

IMPORT_WITHOUT = """
import importlib, sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {extras!r}:
            raise ModuleNotFoundError(f"{{name}} is not installed", name=name)

sys.meta_path.insert(0, Absent())
sys.path.insert(0, {source!r})
for name in {names!r}:
    importlib.import_module(name)
"""


def import_without_extras(names: list[str]) -> subprocess.CompletedProcess[str]:
    """Import modules in a process of its own where every import of an extra fails."""
    script = IMPORT_WITHOUT.format(extras=EXTRAS, source=str(SOURCE), names=names)
    return subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)


def modules_of(package: str) -> list[str]:
    """Return the dotted names of a package's modules."""
    paths = sorted((SOURCE / "archerfish" / package).rglob("*.py"))
    return [".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__") for path in paths]


def test_a_plain_installation_imports_the_robots_packages() -> None:
    done = import_without_extras([name for package in PACKAGES for name in modules_of(package)])
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", ["jax", "jax.numpy"])
def test_jax_really_is_absent_in_that_process(name: str) -> None:
    done = import_without_extras([name])
    assert done.returncode != 0
    assert "is not installed" in done.stderr
