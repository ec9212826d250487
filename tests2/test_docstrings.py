"""What the source says of itself: every public field, and the shapes of arrays; the linter has the rest."""

import ast
import io
import itertools
import re
import tokenize
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"
ARRAY = re.compile(r"\b(Array|NDArray|ArrayLike)\b")
"""Annotations that stand for an array."""
SHAPE = re.compile(r"\b[Ss](hape|calar)s?\b|\bB\b|\(\)|\([^\s(),]+( [+*·] \w+)?,[^()]*\)|[Ss]ee `\w")
"""A shape in words, as B + (2,), as (..., 2) or (N + 1, 2), or in the protocol that is named."""
OF_THE_PROJECT = re.compile(r"ClassVar\[.*|(?!Any$|Path$|Array$)[A-Z]\w*[a-z]\w*( \| None)?")
"""Annotation of a constant, or of a field whose own class says what it is."""
FIELDS = "class C:\n  bare: int\n  place: Array  # (of it)\n  after: int  # [m]\n"
ARGUMENTS = "def f(x: Array):\n  '''Turn.\n\n  Args:\n    y: a place.\n  '''"


def complaints(source):
    """Yield what is not documented as it should be in a module."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {each.start[0]: each.string for each in tokens if each.type == tokenize.COMMENT}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            yield from of_fields(node, comments) if isinstance(node, ast.ClassDef) else of_arguments(node)


def of_fields(node, comments):
    """Complain about fields with neither docstring nor comment, and about arrays without a shape."""
    for field, below in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        beside = itertools.takewhile(comments.get, range(field.end_lineno, below.lineno if below else 9999))
        said = [comments[line] for line in beside]
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            said.append(str(below.value.value))
        name, kind = f"{node.name}.{field.target.id}", ast.unparse(field.annotation)
        if not (said or OF_THE_PROJECT.fullmatch(kind) or field.target.id.startswith("_")):
            yield f"{name} has neither docstring nor comment"
        elif ARRAY.search(kind) and not SHAPE.search(" ".join([*said, ast.get_docstring(node) or ""])):
            yield f"{name} is an array without a shape"


def of_arguments(node):
    """Complain about described arguments that don't exist, and about arrays without a shape."""
    every, docstring = (
        [each for each in ast.walk(node.args) if isinstance(each, ast.arg)],
        ast.get_docstring(node) or "",
    )
    section = re.findall(r"^Args:\n((?:  .*\n?|\n)*)", docstring, re.MULTILINE)
    for name in set(re.findall(r"^  (\w+): ", "".join(section), re.MULTILINE)) - {each.arg for each in every}:
        yield f"{node.name} describes {name}, which is not an argument"
    kinds = [ast.unparse(each.annotation) for each in every if each.annotation and each is not node.args.vararg]
    if docstring and any(ARRAY.search(kind) and "Callable" not in kind for kind in kinds):
        yield from [] if SHAPE.search(docstring) else [f"{node.name} states no shape of an array"]


def test_everything_public_is_documented() -> None:
    paths = sorted((SOURCE / "archerfish2").rglob("*.py"))
    assert [(path, each) for path in paths for each in complaints(path.read_text())] == []


def test_what_is_missing_is_found() -> None:
    fields = ["C.bare has neither docstring nor comment", "C.place is an array without a shape"]
    arguments = ["f describes y, which is not an argument", "f states no shape of an array"]
    assert list(complaints(FIELDS + ARGUMENTS)) == [*fields, *arguments]
