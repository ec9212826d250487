"""The order of the packages: each imports only from those before it; and what an import may load."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
HOUSE = """
errors arrays storage provenance progress workers compiled plugins
records paper dynamics protocols targets robot task messages reports
logs · tracking
identification · controllers
export
simulation · virtual_robot
evaluation learning studies viewer cli
"""
"""A line imports from the lines above it; what a "·" parts don't import each other, else from the left to the right."""

MODULES = sorted(each.relative_to(SOURCE) for each in (SOURCE / "archerfish2").rglob("*.py"))
ROWS = [line.split() for line in HOUSE.split("\n") if line]
MAY: dict[str, set[str]] = {}
for number, row in enumerate(ROWS):
    above = {name for line in ROWS[:number] for name in line} - {"·"}
    MAY |= {name: above | (set() if "·" in row else set(row[:place])) for place, name in enumerate(row)}
for name in MAY.keys() - {"evaluation", "studies", "viewer", "cli"}:
    MAY[name] -= {"virtual_robot"}


def imported(path: Path, source: str) -> Iterator[tuple[int, str]]:
    """Yield line and dotted name of every import of a module, those inside functions included."""
    package = path.parent.parts
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((node.lineno, each.name) for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            yield from ((node.lineno, ".".join(filter(None, [*base, node.module, each.name]))) for each in node.names)


def breaches(path: Path, source: str) -> list[str]:
    """Return the imports of a module at `path` (relative to src/) that break the order."""
    here = path.with_suffix("").parts[1]
    if here not in MAY and here not in ("__init__", "__main__"):
        return [f"{path}: {here} has no place in the order"]
    allowed = MAY.get(here, MAY.keys()) | {here}
    found = []
    for line, name in imported(path, source):
        top, _, rest = name.partition(".")
        part = rest.partition(".")[0]
        if top == "archerfish" or (top == "archerfish2" and part not in allowed and not part.startswith("__")):
            found.append(f"{path}:{line}: {here} imports {name}")
    return found


def test_every_package_imports_only_from_those_before_it() -> None:
    found = [each for path in MODULES for each in breaches(path, (SOURCE / path).read_text())]
    assert not found, "\n" + "\n".join(found)


def test_only_the_comparison_with_the_first_edition_imports_it() -> None:
    paths = [path for path in Path(__file__).parent.rglob("*.py") if "against_first" not in path.parts]
    names = {path.name: [name for _, name in imported(path, path.read_text())] for path in paths}
    assert [path for path, each in names.items() if any(name.split(".")[0] == "archerfish" for name in each)] == []


@pytest.mark.parametrize(
    ("path", "source", "count"),
    [
        ("dynamics/pellet.py", "def late():\n    from ..targets.motion import at", 1),
        ("arrays.py", "import archerfish2.storage", 1),
        ("storage.py", "from archerfish2.arrays import Array\nfrom archerfish2 import __version__", 0),
        ("logs/bags.py", "from archerfish2 import tracking", 1),
        ("learning/train.py", "from archerfish2.virtual_robot import lab", 1),
        ("cli/main.py", "from archerfish.cli import main", 1),
        ("gadgets/thing.py", "", 1),
    ],
)
def test_a_breach_of_the_order_is_found(path: str, source: str, count: int) -> None:
    assert len(breaches(Path("archerfish2") / path, source)) == count


def test_everything_down_to_export_and_the_evaluation_import_without_the_large_libraries(run_python) -> None:
    names = [*list(MAY)[: list(MAY).index("export") + 1], "evaluation"]
    parts = [path.with_suffix("").parts for path in MODULES]
    wanted = [".".join(each).removesuffix(".__init__") for each in parts if each[1] in ("__init__", *names)]
    code = f"import importlib\nfor name in {wanted!r}:\n    importlib.import_module(name)"
    run_python(code, blocked=("jax", "scipy", "matplotlib", "gymnasium"))


def test_the_package_itself_imports_none_of_the_large_libraries(run_python) -> None:
    large = ("numpy", "jax", "scipy", "matplotlib", "gymnasium")
    assert run_python(f"import archerfish2, sys\nprint(*[each for each in {large} if each in sys.modules])") == "\n"
