"""The order of the packages: each imports only from those before it; and what an import may load."""

import ast
from pathlib import Path

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
MAY: dict[str, set[str]] = {}
for row in HOUSE.split("\n"):
    above, words = set(MAY), row.split()
    MAY |= {name: above | (set() if "·" in words else set(words[:at])) for at, name in enumerate(words) if name != "·"}
for name in MAY.keys() - {"evaluation", "studies", "viewer", "cli"}:
    MAY[name] -= {"virtual_robot"}


def imported(path, source):
    """Yield line and dotted name of every import of a module, those inside functions included."""
    package = path.parent.parts
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            yield from ((node.lineno, ".".join(filter(None, [*base, node.module, each.name]))) for each in node.names)
        elif isinstance(node, ast.Import):
            yield from ((node.lineno, each.name) for each in node.names)


def breaches(path, source):
    """Return the imports of a module at `path` (relative to src/) that break the order."""
    here, found = path.with_suffix("").parts[1], []
    if here not in (*MAY, "__init__", "__main__"):
        return [f"{path}: {here} has no place in the order"]
    for line, name in imported(path, source):
        top, part = f"{name}.".split(".")[:2]
        inside = part in MAY.get(here, MAY) or part == here or part.startswith("__")
        if top == "archerfish" or (top == "archerfish2" and not inside):
            found.append(f"{path}:{line}: {here} imports {name}")
    return found


def test_every_package_imports_only_from_those_before_it() -> None:
    assert [each for path in MODULES for each in breaches(path, (SOURCE / path).read_text())] == []


def test_only_the_comparison_with_the_first_edition_imports_it() -> None:
    paths = [path for path in Path(__file__).parent.rglob("*.py") if "against_first" not in path.parts]
    names = {name.split(".")[0] for path in paths for _, name in imported(path, path.read_text())}
    assert "archerfish2" in names
    assert "archerfish" not in names


def test_a_breach_of_the_order_is_found() -> None:
    late = "def late():\n    from ..targets.motion import at"
    breach = {"dynamics/pellet.py": late, "arrays.py": "import archerfish2.storage", "gadgets/thing.py": ""}
    breach |= {"logs/bags.py": "from archerfish2 import tracking", "cli/main.py": "from archerfish.cli import main"}
    breach["learning/train.py"] = "from archerfish2.virtual_robot import lab"
    assert [len(breaches(Path("archerfish2", path), source)) for path, source in breach.items()] == [1] * 6
    allowed = "from archerfish2.arrays import Array\nfrom archerfish2 import __version__"
    assert breaches(Path("archerfish2/storage.py"), allowed) == []


def test_everything_down_to_export_and_the_evaluation_import_without_the_large_libraries(run_python) -> None:
    names = ["__init__", *list(MAY)[: list(MAY).index("export") + 1], "evaluation"]
    wanted = [".".join(each.with_suffix("").parts).removesuffix(".__init__") for each in MODULES]
    wanted = [each for each in wanted if (each + ".__init__").split(".")[1] in names]
    code = f"import importlib\nfor name in {wanted!r}:\n    importlib.import_module(name)"
    run_python(code, blocked=("jax", "scipy", "matplotlib", "gymnasium"))


def test_the_package_itself_imports_none_of_the_large_libraries(run_python) -> None:
    large = ("numpy", "jax", "scipy", "matplotlib", "gymnasium")
    assert run_python(f"import archerfish2, sys\nprint(*[each for each in {large} if each in sys.modules])") == "\n"
