"""Mutants of the gate, the plausibility and the stream against their tests: small changes that a test should find.

`python benchmarks/mutants.py [MODULE…]`: for each operator, comparison, constant, condition, mode and reason of a
module a mutant that has another one; the module's tests run on it, without those of JAX. One that ends with an error
or runs for a minute is found. Prints the mutants that no test finds, and why each is equal to the original. Takes some
minutes. Writes results/mutants.json; of modules that are named, their part of it.
"""

import argparse
import ast
import contextlib
import copy
import importlib
import io
import json
import multiprocessing
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from alternating import ROOT

MODULES = {
    "safety.gate": "safety/test_gate.py",
    "safety.plausibility": "safety/test_plausibility.py",
    "wires.stream": "wires/test_stream.py",
}
"""Module → its tests."""
MARGIN = "a timer's margin is there so that no timer is at its limit: any that is above rounding and below a period"
SHAPE = "only the shape of the element is used"
SWITCH = "the switch is 0 or 1"
EQUAL = {
    "module: 0.0001 → 0.00015000000000000001": MARGIN,
    "module: 0.0001 → 7.500000000000001e-05": MARGIN,
    "resting_gate: 0 → 1": SHAPE,
    "resting_prediction: 0 → 1": SHAPE,
    "gate: good_for >= rules.steady - _TIMER_MARGIN_S → good_for > rules.steady - _TIMER_MARGIN_S": MARGIN,
    "gate: bad_for >= rules.lost - _TIMER_MARGIN_S → bad_for > rules.lost - _TIMER_MARGIN_S": MARGIN,
    "gate: since_shot < rules.interval - _TIMER_MARGIN_S → since_shot <= rules.interval - _TIMER_MARGIN_S": MARGIN,
    "gate: sent_for < rules.settling - _TIMER_MARGIN_S → sent_for <= rules.settling - _TIMER_MARGIN_S": MARGIN,
    "gate: state.switch_on > 0.5 → state.switch_on >= 0.5": SWITCH,
    "gate: 0.5 → 0.75": SWITCH,
    "gate: 0.5 → 0.375": SWITCH,
    "gate: xp.zeros_like → xp.ones_like": "the line of sight, which no limit of a gate depends on",
}
"""Mutant that no test finds → why it decides as the original does."""
LONGEST_S = 60
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
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
}
NAMES = {
    "min": "max",
    "max": "min",
    "minimum": "maximum",
    "any": "all",
    "all": "any",
    "zeros_like": "ones_like",
    "ones_like": "zeros_like",
}
MODES = ("DISARMED", "ARMED", "HOLD", "FAULT")


def replacements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may stand in the place of a node."""
    new: Any = copy.deepcopy(node)
    if isinstance(node, ast.BinOp | ast.AugAssign):
        for operator in OPERATORS.get(type(node.op), ()):
            new.op = operator()
            yield copy.deepcopy(new)
    if isinstance(node, ast.Compare):
        for operator in OPERATORS.get(type(node.ops[0]), ()):
            new.ops = [operator()]
            yield copy.deepcopy(new)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Invert | ast.USub | ast.Not):
        yield node.operand
    if isinstance(node, ast.If | ast.IfExp) and not isinstance(node.test, ast.UnaryOp):
        new.test = ast.UnaryOp(ast.Not(), node.test)
        yield new
    if isinstance(node, ast.Break):
        yield ast.Continue()
    if isinstance(node, ast.Constant) and isinstance(node.value, int):
        yield ast.Constant(not node.value if isinstance(node.value, bool) else node.value + 1)
    if isinstance(node, ast.Name) and node.id in NAMES:
        new.id = NAMES[node.id]
        yield new
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


def mutants(source: str) -> list[tuple[str, str]]:
    """Return the changed text and the source of each mutant; enumerations and tuples stay."""
    tree, found = ast.parse(source), []
    methods = [part for whole in tree.body if isinstance(whole, ast.ClassDef) for part in whole.body]
    parts = [part for part in [*tree.body, *methods] if isinstance(part, ast.FunctionDef | ast.Assign)]
    enumerations = {id(part) for part in methods if isinstance(part, ast.Assign)}
    for part in parts:
        for node in ast.walk(part):
            for new in replacements(node) if id(part) not in enumerations else ():
                changed = Replace(node, new).visit(copy.deepcopy(tree))
                texts = [ast.unparse(code).split("\n")[0] for code in (node, new)]
                text = f"{getattr(part, 'name', 'module')}: {' → '.join(texts)}"
                found.append((text, ast.unparse(ast.fix_missing_locations(changed))))
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


def is_found(name: str, source: str) -> bool:
    """Whether a test fails on a mutant; in a process of its own."""
    import pytest

    module = importlib.import_module(f"archerfish.{name}")
    original = dict(vars(module))
    signal.alarm(LONGEST_S)  # ends the process
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            exec(compile(source, str(module.__file__), "exec"), module.__dict__)
        except Exception:
            return True
        for other in [other for key, other in sys.modules.items() if key.startswith("archerfish")]:
            for key, value in list(vars(other).items()):  # what has imported from the module before
                if key in original and value is original[key]:
                    setattr(other, key, getattr(module, key))
        words = ["-x", "-q", "-p", "no:cacheprovider", "-k", "not jax", str(ROOT / "tests" / MODULES[name])]
        return pytest.main(words) != pytest.ExitCode.OK


def survivors(name: str, every: list[tuple[str, str]], source: str) -> list[str]:
    """Return the mutants that no test finds, and print them."""
    import pytest  # noqa: F401  before the processes are forked

    importlib.import_module(f"archerfish.{name}")
    left, fork = [], multiprocessing.get_context("fork")
    for at, (text, changed) in enumerate([("the module itself", source), *every]):
        answer: Any = fork.Queue()
        process = fork.Process(target=lambda *task: answer.put(is_found(*task)), args=(name, changed))  # noqa: B023
        process.start()
        process.join()
        found = process.exitcode != 0 or answer.get()
        if at == 0:
            assert not found, f"the tests fail on {name} itself"
        elif not found:
            left.append(text)
            print(f"{name}, {at} of {len(every)}: {text}: {EQUAL.get(text, 'NOT EXPLAINED')}", flush=True)
    return left


def main() -> None:
    """Run the tests on each mutant, print, write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("modules", nargs="*", default=[], choices=[*MODULES, []])
    path = Path(__file__).parent / "results" / "mutants.json"
    stored = json.loads(path.read_text()) if path.exists() else {}
    rows = {name: stored[name] for name in MODULES if name in stored}
    for name in parser.parse_args().modules or MODULES:
        source = (ROOT / "src" / "archerfish" / f"{name.replace('.', '/')}.py").read_text()
        every = mutants(source)
        left = survivors(name, every, source)
        share = round(100.0 * (1.0 - len(left) / len(every)), 1)
        not_found = {text: EQUAL.get(text, "not explained") for text in left}
        rows[name] = {"mutants": len(every), "found_percent": share, "not found": not_found}
        print(f"{name}: {len(every)} mutants, {share:.1f} % found", flush=True)
        rows[name]["date"] = time.strftime("%F")
        path.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
