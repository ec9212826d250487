"""What the source says of itself: every module, public class, field and function, with shapes where it has arrays."""

import ast
import io
import itertools
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
ARRAY = re.compile(r"\b(Array|NDArray|ArrayLike)\b")
"""Annotations that stand for an array."""
SHAPE = re.compile(r"\b[Ss](hape|calar)s?\b|\bB\b|\(\)|\([^\s(),]+( [+*·] \w+)?,[^()]*\)|[Ss]ee `\w")
"""A shape in words, as B + (2,), as (..., 2) or (N + 1, 2), or in the protocol that is named."""
OF_THE_PROJECT = re.compile(r"ClassVar\[.*|(?!Any$|Path$|Array$)[A-Z]\w*[a-z]\w*( \| None)?")
"""Annotation of a constant, or of a field whose own class says what it is."""


def complaints(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and complaint for everything in a module that is not documented as it should be."""
    module = ast.parse(source)
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    comments = {each.start[0]: each.string for each in tokens if each.type == tokenize.COMMENT}
    if not ast.get_docstring(module):
        yield 1, "the module has no docstring"
    yield from in_body(module.body, comments)


def in_body(body: list[ast.stmt], comments: dict[int, str]) -> Iterator[tuple[int, str]]:
    for node in body:
        if not isinstance(node, ast.ClassDef | ast.FunctionDef) or node.name.startswith("_"):
            continue
        docstring = ast.get_docstring(node) or ""
        if not re.match(r"[^\n]*([^\n]\n[^\n]+)*[.:…](\n\n|$)", docstring):
            yield node.lineno, f"{node.name} has no docstring that begins with a sentence"
        if isinstance(node, ast.ClassDef):
            yield from of_fields(node, docstring, comments)
            yield from in_body(node.body, comments)
        else:
            yield from of_arguments(node, docstring)


def of_fields(node: ast.ClassDef, of_class: str, comments: dict[int, str]) -> Iterator[tuple[int, str]]:
    """Complain about fields with neither docstring nor comment, and about arrays without a shape."""
    for field, below in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        beside = itertools.takewhile(comments.get, range(field.end_lineno or 0, below.lineno if below else 9999))
        said = [comments[line] for line in beside]
        if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant):
            said.append(str(below.value.value))
        name, kind = f"{node.name}.{field.target.id}", ast.unparse(field.annotation)
        if not (said or OF_THE_PROJECT.fullmatch(kind) or field.target.id.startswith("_")):
            yield field.lineno, f"{name} has neither docstring nor comment"
        elif ARRAY.search(kind) and not SHAPE.search(" ".join([*said, of_class])):
            yield field.lineno, f"{name} is an array without a shape"


def of_arguments(node: ast.FunctionDef, docstring: str) -> Iterator[tuple[int, str]]:
    """Complain about described arguments that don't exist, and about arrays without a shape."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    known = {each.arg for each in [*arguments, node.args.vararg, node.args.kwarg] if each is not None}
    section = re.findall(r"^Args:\n((?:  .*\n?|\n)*)", docstring, re.MULTILINE)
    for name in set(re.findall(r"^  (\w+): ", "".join(section), re.MULTILINE)) - known:
        yield node.lineno, f"{node.name} describes {name}, which is not an argument"
    kinds = [ast.unparse(each.annotation) for each in arguments if each.annotation]
    if any(ARRAY.search(kind) and "Callable" not in kind for kind in kinds) and not SHAPE.search(docstring):
        yield node.lineno, f"{node.name} states no shape of an array"


def test_everything_public_is_documented() -> None:
    paths = sorted((SOURCE / "archerfish2").rglob("*.py"))
    found = [
        f"{path.relative_to(SOURCE)}:{line}: {each}" for path in paths for line, each in complaints(path.read_text())
    ]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("x = 1", "the module has no docstring"),
        ('"""M."""\ndef f():\n    """Turn"""', "f has no docstring"),
        ('"""M."""\nclass C:\n    """C."""\n    def f(self): ...', "f has no docstring"),
        ('"""M."""\nclass C:\n    """C."""\n    x: int\n    y: int  # [m]', "C.x has neither"),
        ('"""M."""\nclass C:\n    """C."""\n    x: Array  # a place (of it) [m]', "C.x is an array without a shape"),
        ('"""M."""\ndef f(x: Array):\n    """Turn a place."""', "f states no shape"),
        ('"""M."""\ndef f(x):\n    """Turn.\n\n    Args:\n      y: a place.\n    """', "f describes y"),
    ],
)
def test_what_is_missing_is_found(source: str, complaint: str) -> None:
    assert [complaint in each for _, each in complaints(source)] == [True]


def test_a_comment_or_a_docstring_documents_a_field() -> None:
    fields = [
        "x: Array  # [m], B + (3,)",
        "y: Array  # of x,",
        "#  (..., 2)",
        "z: int",
        '"""Count."""',
        "frames: Frames",
    ]
    assert list(complaints('"""M."""\nclass C:\n    """C."""\n    ' + "\n    ".join(fields))) == []
