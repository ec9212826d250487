"""How the source is written: its words, and what it says of fields and of arrays.

Linters hold the rest of what is documented, and the order of the packages.
"""

import ast
import collections
import io
import itertools
import re
import tokenize
from pathlib import Path

ROOT, SOURCE = Path(__file__).parents[1], Path(__file__).parents[1] / "src"
FILES = {path.relative_to(SOURCE): path.read_text() for path in sorted((SOURCE / "archerfish").rglob("*.py"))}
WORDS = r"told|hear[sd]?|foret\w+|anew|whom|wish\w*|f(igh|ough)t\w*|(entrant|rival|workbench|stand-in|sighting)\w*"
TEXT = re.compile(rf"(?i)\b({WORDS})\b")
"""Words that stand in no text; the help of a command is text of its source."""
DEFINITION = ast.ClassDef | ast.FunctionDef
PARTS = {"way", "chance", "sight", "bench", "standing", "ground"}
"""Words that are no part of an identifier."""

ARRAY = re.compile(r"\b(Array|NDArray|ArrayLike)\b")
"""Annotations that stand for an array."""
SHAPE = re.compile(r"\b[Ss](hape|calar)s?\b|\bB\b|\(\)|\([^\s(),]+( [+*·] \w+)?,[^()]*\)|[Ss]ee `\w")
"""A shape in words, as B + (2,), as (..., 2) or (N + 1, 2), or in the protocol that is named."""
OF_THE_PROJECT = re.compile(r"ClassVar\[.*|(?!Any$|Path$|Array$)[A-Z]\w*[a-z]\w*( \| None)?")
"""Annotation of a constant, or of a field whose own class says what it is."""


def tokens(source, kind):
    """Return the tokens of a kind."""
    return [each for each in tokenize.generate_tokens(io.StringIO(source).readline) if each.type == kind]


def in_text(text):
    """Return the words of a text, identifiers taken apart, that should not be there."""
    return [match[0] for match in TEXT.finditer(text.replace("_", " "))]


def in_name(name):
    """Whether an identifier has such a part; the line of sight is a standard term."""
    parts = re.findall("[A-Z]?[a-z]+|[A-Z]+(?![a-z])", re.sub("(?i)line_?of_?sight", "", name))
    return not PARTS.isdisjoint(part.lower().removesuffix("s") for part in parts)


def undocumented(source):
    """Yield what is not documented as it should be in a module."""
    comments = {each.start[0]: each.string for each in tokens(source, tokenize.COMMENT)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, DEFINITION) and not node.name.startswith("_"):
            docstring = ast.get_docstring(node) or ""
            yield from (of_fields if isinstance(node, ast.ClassDef) else of_arguments)(node, docstring, comments)


def of_fields(node, docstring, comments):
    """Complain about fields with neither docstring nor comment, and about arrays without a shape."""
    for field, below in zip(node.body, [*node.body[1:], None], strict=True):
        if isinstance(field, ast.AnnAssign):
            beside = itertools.takewhile(comments.get, range(field.end_lineno, below.lineno if below else 9999))
            said = [comments[line] for line in beside] + ([ast.unparse(below)] if isinstance(below, ast.Expr) else [])
            name, kind = f"{node.name}.{field.target.id}", ast.unparse(field.annotation)
            if not (said or OF_THE_PROJECT.fullmatch(kind) or field.target.id.startswith("_")):
                yield f"{name} has neither docstring nor comment"
            elif ARRAY.search(kind) and not SHAPE.search(" ".join([*said, docstring])):
                yield f"{name} is an array without a shape"


def of_arguments(node, docstring, _):
    """Complain about arrays without a shape."""
    every = [each for each in ast.walk(node.args) if isinstance(each, ast.arg) and each is not node.args.vararg]
    kinds = [ast.unparse(each.annotation) for each in every if each.annotation]
    arrays = [kind for kind in kinds if ARRAY.search(kind) and "Callable" not in kind]
    if docstring and arrays and not SHAPE.search(docstring):
        yield f"{node.name} states no shape of an array"


def test_everything_down_to_export_and_the_evaluation_import_without_the_large_libraries(run_python):
    others = {"simulation", "virtual_robot", "learning", "studies", "viewer", "cli", "__main__", "identification"}
    names = {path: ".".join(path.with_suffix("").parts).removesuffix(".__init__") for path in FILES}
    first = [name for path, name in names.items() if path.with_suffix("").parts[1] not in others]
    for wanted, blocked in ((first, ("scipy",)), ([each for each in names.values() if "identification" in each], ())):
        code = f"import importlib\nfor name in {wanted!r}:\n    importlib.import_module(name)"
        run_python(code, blocked=("jax", "matplotlib", "gymnasium", *blocked))


def test_the_package_itself_imports_none_of_the_large_libraries(run_python):
    large = ("numpy", "jax", "scipy", "matplotlib", "gymnasium")
    assert run_python(f"import archerfish, sys\nprint(*[each for each in {large} if each in sys.modules])") == "\n"
    code = "import os; del os.environ['OMP_NUM_THREADS']; import archerfish.cli.main as m; print(*os.environ)"
    assert "OMP_NUM_THREADS" not in run_python(code)  # set by the program alone, not for who imports it


def test_texts_are_plain_english_and_identifiers_technical_terms():
    pages = {path: path.read_text() for path in (ROOT / "docs").rglob("*.md")}
    assert {str(path): words for path, text in (FILES | pages).items() if (words := in_text(text))} == {}
    for path, source in FILES.items():
        names = {each.string for each in tokens(source, tokenize.NAME)} | {path.stem, path.parent.name}
        assert not list(filter(in_name, names)), path


def public_names(source):
    """Yield the names that a module defines, but for those of type variables, each the same in its own function."""
    for node in ast.parse(source).body:
        if isinstance(node, DEFINITION):
            yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign) and "TypeVar(" not in ast.unparse(node):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            yield from (name.id for target in targets for name in ast.walk(target) if isinstance(name, ast.Name))


def functions(source):
    """Yield the name of each function outside classes, and what it does."""
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            yield (
                node.name,
                ast.dump(node.args) + "".join(map(ast.dump, node.body[ast.get_docstring(node) is not None :])),
            )


def test_a_public_name_has_one_meaning():
    names = [name for source in FILES.values() for name in public_names(source) if name[0] != "_" and name != "Array"]
    assert [name for name, count in collections.Counter(names).items() if count > 1] == []
    assert [*public_names("A, _b = 1, 2\nC: int = 3\nT = TypeVar('T')\ndef d(): e = 1")] == ["A", "_b", "C", "d"]


def test_no_function_stands_twice():
    bodies = collections.defaultdict(list)
    for path, source in FILES.items():
        for name, body in functions(source):
            bodies[body].append(f"{path}: {name}")
    assert [places for places in bodies.values() if len(places) > 1] == []
    assert len({body for _, body in functions("def a(x): return x\ndef b(x):\n  'B.'\n  return x")}) == 1


def test_fields_and_shapes_are_documented():
    assert [(path, each) for path, source in FILES.items() for each in undocumented(source)] == []


def test_what_is_wrong_is_found():
    assert len(in_text("The filter was told Anew. when_heard = 1; two stand-ins, a rival; retold")) == 5
    assert all(map(in_name, ("hit_chance", "HitChance", "ways", "SIGHT")))
    assert not any(map(in_name, ("line_of_sight", "LineOfSight", "background", "always")))
    fields = "class C:\n  bare: int\n  place: Array  # (of it)\n  after: int  # [m]\n"
    arguments = "def f(x: Array):\n  '''Turn.'''"
    complaints = ["C.bare has neither docstring nor comment", "C.place is an array without a shape"]
    assert list(undocumented(fields + arguments)) == [*complaints, "f states no shape of an array"]
