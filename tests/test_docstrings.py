"""What the source says of itself: every module, public class, field and function, with shapes where it has arrays."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[1] / "src"
ARRAY = re.compile(r"\b(Array|NDArray|ArrayLike|Floats|Matrix|ComplexArray)\b")
"""Annotations that stand for an array."""
SHAPE = re.compile(r"[Ss]hapes?\b|[Ss]calars?\b|PRNG key|\bB \+ \(|\((\w+, )*\w*,?\)")
"""How a docstring tells a shape: in words, as B + (2,), or as (N, 2); a key of JAX has none."""
ELSEWHERE = "named as in"
"""What a class says whose fields are described in another."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


def is_public(node: ast.AST) -> bool:
    """Whether a definition is meant for other modules; protocols' special methods explain themselves."""
    return isinstance(node, ast.ClassDef | Function) and not node.name.startswith("_")


def complaints(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and complaint for everything in a module that is not documented as it should be."""
    module = ast.parse(source)
    if not ast.get_docstring(module):
        yield 1, "the module has no docstring"
    yield from _in_body(module.body)


def _in_body(body: list[ast.stmt]) -> Iterator[tuple[int, str]]:
    for node in filter(is_public, body):
        assert isinstance(node, ast.ClassDef | Function)
        docstring = ast.get_docstring(node) or ""
        if not docstring:
            yield node.lineno, f"{node.name} has no docstring"
        elif not re.match(r"[^\n]*([^\n]\n[^\n]+)*[.:…](\n\n|$)", docstring):
            yield node.lineno, f"{node.name}: the docstring must begin with a sentence"
        if isinstance(node, ast.ClassDef):
            yield from _of_fields(node, docstring)
            yield from _in_body(node.body)
        elif docstring:
            yield from _of_arguments(node, docstring)


def _of_fields(node: ast.ClassDef, of_class: str) -> Iterator[tuple[int, str]]:
    """Complain about fields without a docstring, and about arrays without a shape."""
    if ELSEWHERE in of_class:
        return
    for field, below in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(field, ast.AnnAssign) or not isinstance(field.target, ast.Name):
            continue
        name = f"{node.name}.{field.target.id}"
        told = below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else None
        if not isinstance(told, str):
            yield field.lineno, f"{name} has no docstring"
        elif ARRAY.search(ast.unparse(field.annotation)) and not (SHAPE.search(told) or SHAPE.search(of_class)):
            yield field.lineno, f"{name} is an array without a shape"


def _of_arguments(node: Function, docstring: str) -> Iterator[tuple[int, str]]:
    """Complain about described arguments that don't exist, and about arrays whose shape is told nowhere."""
    arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
    known = {each.arg for each in [*arguments, node.args.vararg, node.args.kwarg] if each is not None}
    for name in re.findall(r"^  (\w+): ", _section(docstring, "Args"), re.MULTILINE):
        if name not in known:
            yield node.lineno, f"{node.name} describes {name}, which is not an argument"
    kinds = {each.arg: ast.unparse(each.annotation) for each in arguments if each.annotation}
    arrays = [name for name, kind in kinds.items() if ARRAY.search(kind) and not kind.startswith("Callable")]
    if arrays and not SHAPE.search(docstring):
        yield node.lineno, f"{node.name} tells no shape of {', '.join(arrays)}"


def _section(docstring: str, title: str) -> str:
    found = re.search(rf"^{title}:\n((?:  .*\n?|\n)*)", docstring, re.MULTILINE)
    return found[1] if found else ""


@pytest.mark.parametrize(
    "path", sorted((SOURCE / "archerfish").rglob("*.py")), ids=lambda path: str(path.relative_to(SOURCE))
)
def test_everything_public_is_documented(path: Path) -> None:
    found = [f"{path.relative_to(SOURCE)}:{line}: {complaint}" for line, complaint in complaints(path.read_text())]
    assert not found, "\n" + "\n".join(found)


@pytest.mark.parametrize(
    ("source", "complaint"),
    [
        ("x = 1", "the module has no docstring"),
        ('"""M."""\ndef f(): ...', "f has no docstring"),
        ('"""M."""\nclass C: ...', "C has no docstring"),
        ('"""M."""\nclass C:\n    """C."""\n    def f(self): ...', "f has no docstring"),
        ('"""M."""\nclass C:\n    """C."""\n    x: int', "C.x has no docstring"),
        ('"""M."""\nclass C:\n    """C."""\n    x: Array\n    """A place [m]."""', "C.x is an array without a shape"),
        ('"""M."""\ndef f(x: Array):\n    """Turn a place."""', "f tells no shape of x"),
        ('"""M."""\ndef f(x):\n    """Turn.\n\n    Args:\n      y: a place.\n    """', "f describes y"),
        ('"""M."""\ndef f():\n    """Turn"""', "must begin with a sentence"),
    ],
)
def test_what_is_missing_is_found(source: str, complaint: str) -> None:
    found = [told for _, told in complaints(source)]
    assert len(found) == 1
    assert complaint in found[0]


@pytest.mark.parametrize(
    "source",
    [
        '"""M."""\ndef _f(): ...',
        '"""M."""\ndef f(x: Array):\n    """Turn a place [m], shape B + (3,)."""',
        '"""M."""\nclass C:\n    """Settings, named as in `D`."""\n    x: Array',
        '"""M."""\ndef f(g: Callable[[Array], Array]):\n    """Call."""',
    ],
)
def test_what_needs_no_more_is_accepted(source: str) -> None:
    assert list(complaints(source)) == []
