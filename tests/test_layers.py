"""The import order of the packages: each imports only from those before it, never from one beside it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"

LAYERS = (
    {"records"},
    {"paper"},
    {"figures"},
    {"dynamics"},
    {"targets"},
    {"sensing"},
    {"identification", "simulation", "virtual_robot", "controllers"},
    {"learning"},
    {"evaluation", "deployment"},
    {"viewer"},
    {"cli"},
)
"""Packages in one set stand beside each other and meet only through the files of `records`."""

LEAVES = {"plugins": ("archerfish.records.errors",)}
"""Modules beside the packages, which all of these may import → what of the packages they import themselves."""

LAYER = {package: index for index, packages in enumerate(LAYERS) for package in packages}


def imported_modules(source: str, package: list[str]) -> Iterator[tuple[int, str]]:
    """Yield line and dotted name of every import, those inside functions and TYPE_CHECKING blocks included."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join(start + ([node.module] if node.module else []))
            yield from ((node.lineno, f"{base}.{alias.name}") for alias in node.names)


def violations(source: str, path: Path) -> list[str]:
    """Return a sentence for each import of a module at `path` (relative to src/) that breaks the order."""
    package = list(path.parent.parts)
    if len(package) < 2 and path.stem in LEAVES:
        found = [(line, name) for line, name in imported_modules(source, package) if name.startswith("archerfish")]
        return [
            f"src/{path}:{line}: a leaf imports {name}; it may import: {', '.join(LEAVES[path.stem])}"
            for line, name in found
            if not name.startswith(LEAVES[path.stem])
        ]
    if len(package) < 2:
        return [f"src/{path}: only packages live in archerfish/; move the module into one"] * (path.stem != "__init__")
    here = package[1]
    if here not in LAYER:
        return [f"src/{path}: package {here} has no place in the order; give it one in {Path(__file__).name}"]
    allowed = {name for name, layer in LAYER.items() if layer < LAYER[here]} | {here, *LEAVES}
    found = []
    for line, name in imported_modules(source, package):
        parts = name.split(".")
        # archerfish.__version__ belongs to no package.
        if parts[0] == "archerfish" and len(parts) > 1 and not parts[1].startswith("__") and parts[1] not in allowed:
            may = ", ".join(sorted(allowed - {here, *LEAVES}, key=LAYER.__getitem__)) or "none"
            found.append(f"src/{path}:{line}: {here} imports {name}; of the other packages it may import: {may}")
    return found


def test_every_package_imports_only_from_packages_before_it() -> None:
    modules = sorted((SOURCE / "archerfish").rglob("*.py"))
    assert modules
    found = [each for module in modules for each in violations(module.read_text(), module.relative_to(SOURCE))]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("dynamics/pellet.py", "import archerfish.sensing.observation"),
        ("dynamics/pellet.py", "from archerfish import sensing"),
        ("dynamics/pellet.py", "from ..sensing import observation"),
        ("dynamics/pellet.py", "def late():\n    from archerfish.sensing.observation import observe"),
        ("simulation/shooting.py", "from archerfish.controllers import oracle"),
        ("gadgets/thing.py", ""),
        ("records/plant.py", "from archerfish.gadgets import thing"),
        ("thing.py", ""),
        ("plugins.py", "from archerfish.records.plant import PlantRecord"),
    ],
)
def test_a_breach_of_the_order_is_found(path: str, source: str) -> None:
    assert len(violations(source, Path("archerfish") / path)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("__init__.py", ""),
        ("sensing/observation.py", "from archerfish.dynamics.pellet import GRAVITY"),
        ("sensing/observation.py", "from .interfaces import Seen"),
        ("sensing/observation.py", "from ..dynamics import pellet"),
        ("records/provenance.py", "from archerfish import __version__"),
        ("cli/main.py", "import numpy, archerfish.records.plant"),
        ("records/plant.py", "from archerfish.plugins import names_code"),
        ("plugins.py", "from archerfish.records.errors import InputError"),
    ],
)
def test_the_order_itself_is_accepted(path: str, source: str) -> None:
    assert violations(source, Path("archerfish") / path) == []
