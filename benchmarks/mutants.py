"""Mutants of the gate against its tests: small changes of the source, each of which a test should find.

`python benchmarks/mutants.py`: for each operator, comparison, constant, mode and reason of safety/gate.py a mutant that
has another one; the tests of tests/safety run on it, without those of JAX. Prints the mutants that no test finds.
Takes some minutes. Writes results/mutants.json.
"""

import ast
import contextlib
import copy
import io
import json
import multiprocessing
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from alternating import ROOT

SOURCE = ROOT / "src" / "archerfish" / "safety" / "gate.py"
OPERATORS: dict[type, tuple[type, ...]] = {
    ast.Add: (ast.Sub,),
    ast.Sub: (ast.Add,),
    ast.Mult: (ast.Div,),
    ast.Div: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,),
    ast.BitOr: (ast.BitAnd,),
    ast.Lt: (ast.LtE, ast.Gt),
    ast.LtE: (ast.Lt, ast.GtE),
    ast.Gt: (ast.GtE, ast.Lt),
    ast.GtE: (ast.Gt, ast.LtE),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
}
NAMES = {"minimum": "maximum", "any": "all", "all": "any", "zeros_like": "ones_like", "ones_like": "zeros_like"}
MODES = ("DISARMED", "ARMED", "HOLD", "FAULT")


def replacements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in the place of a node."""
    new: Any = copy.deepcopy(node)
    if isinstance(node, ast.BinOp):
        for operator in OPERATORS.get(type(node.op), ()):
            new.op = operator()
            yield copy.deepcopy(new)
    if isinstance(node, ast.Compare):
        for operator in OPERATORS.get(type(node.ops[0]), ()):
            new.ops = [operator()]
            yield copy.deepcopy(new)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Invert | ast.USub):
        yield node.operand
    if isinstance(node, ast.Constant) and isinstance(node.value, float):
        yield ast.Constant(1.5 * node.value + 0.01 * (node.value == 0.0))
        yield ast.Constant(0.75 * node.value - 0.01 * (node.value == 0.0))
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        if node.attr in NAMES:
            new.attr = NAMES[node.attr]
            yield new
        if node.value.id == "Mode":
            for new.attr in MODES:
                if new.attr != node.attr:
                    yield copy.deepcopy(new)
        if node.value.id == "Reason":
            new.attr = "OFF_TARGET" if node.attr == "HEAT" else "HEAT"
            yield new
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr == "where":
        new.args[1:] = reversed(new.args[1:])
        yield new


def mutants() -> list[tuple[int, int, str, str]]:
    """Return line, column, the changed text and the source of each mutant; enumerations and tuples stay."""
    tree, found = ast.parse(SOURCE.read_text()), []
    parts = [each for each in tree.body if isinstance(each, ast.FunctionDef | ast.Assign)]
    for part in parts:
        for node in ast.walk(part):
            for new in replacements(node):
                changed = Replace(node, new).visit(copy.deepcopy(tree))
                text = f"{ast.unparse(node)} → {ast.unparse(new)}"
                found.append((node.lineno, node.col_offset, text, ast.unparse(ast.fix_missing_locations(changed))))  # type: ignore[attr-defined]
    return found


class Replace(ast.NodeTransformer):
    """Replaces the node at the place and of the type of another one."""

    def __init__(self, node: Any, new: ast.AST) -> None:
        """Take what is replaced, and by what."""
        self.node, self.new = node, new

    def visit(self, node: Any) -> Any:
        """Replace, or go on."""
        place = ("lineno", "col_offset", "end_lineno", "end_col_offset")
        is_here = type(node) is type(self.node) and all(
            getattr(node, name, None) == getattr(self.node, name, None) for name in place
        )
        return copy.deepcopy(self.new) if is_here else self.generic_visit(node)


def is_found(source: str) -> bool:
    """Whether a test fails on a mutant; in a process of its own."""
    import pytest

    from archerfish.safety import gate

    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            exec(compile(source, str(SOURCE), "exec"), gate.__dict__)
        except Exception:
            return True
        words = ["-x", "-q", "-p", "no:cacheprovider", "-k", "not jax", str(ROOT / "tests" / "safety" / "test_gate.py")]
        return pytest.main(words) != pytest.ExitCode.OK


def main() -> None:
    """Run the tests on each mutant, print, write."""
    import pytest  # noqa: F401  before the processes are forked

    import archerfish.safety.rules  # noqa: F401

    every, left = mutants(), []
    with multiprocessing.get_context("fork").Pool(2, maxtasksperchild=1) as pool:  # a run of pytest a process
        assert not pool.apply(is_found, [SOURCE.read_text()]), "the tests fail on the gate itself"
        results = pool.imap(is_found, [source for *_, source in every])
        for at, (mutant, found) in enumerate(zip(every, results, strict=True)):
            if not found:
                left.append(f"line {mutant[0]}: {mutant[2]}")
                print(f"{at + 1} of {len(every)}: {left[-1]}", flush=True)
    share = 100.0 * (1.0 - len(left) / len(every))
    print(f"{len(every)} mutants, {share:.1f} % found")
    made = {"date": time.strftime("%F"), "mutants": len(every), "found_percent": round(share, 1), "not found": left}
    text = json.dumps(made, indent=1, ensure_ascii=False)
    (Path(__file__).parent / "results" / "mutants.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
