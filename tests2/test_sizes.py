"""Lines of code by package against sizes.toml; `python tests2/test_sizes.py` writes what is there now."""

import ast
import collections
import io
import re
import tokenize
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SIZES = ROOT / "tests2" / "sizes.toml"
LEAVES = "__init__ __main__ errors arrays storage provenance workers compiled plugins"
GROUP = dict.fromkeys(LEAVES.split(), "leaves") | dict.fromkeys(("robot", "task", "messages"), "nouns")


def code_lines(source: str) -> int:
    """Count what is left without blank lines, comments and docstrings."""
    empty = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    tokens = [each for each in tokenize.generate_tokens(io.StringIO(source).readline) if each.type not in empty]
    lines = {line for each in tokens for line in range(each.start[0], each.end[0] + 1)}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            lines.difference_update(range(node.lineno, node.end_lineno + 1))
    return len(lines)


def counted() -> dict[str, int]:
    """Return package → its lines of code, the tests without the comparison with the first edition."""
    found = collections.Counter()
    for path in [*(ROOT / "src" / "archerfish2").rglob("*.py"), *(ROOT / "tests2").rglob("*.py")]:
        here = path.relative_to(ROOT).with_suffix("").parts
        name = "tests2" if here[0] == "tests2" else GROUP.get(here[2], here[2])
        found[name] += code_lines(path.read_text()) * ("against_first" not in here)
    return found


def test_sizes_are_those_of_the_code_and_below_their_limits_but_where_the_table_says_so() -> None:
    assert code_lines('"""M.\n\nN."""\n\nimport a  # why\n# note\ndef f():\n """F."""\n return """x\n\ny"""\n') == 5
    rows, found = tomllib.loads(SIZES.read_text()), counted()
    assert found.keys() <= rows.keys(), "give each package a goal in tests2/sizes.toml"
    wrong = {name: found[name] for name, row in rows.items() if row.get("now", found[name]) != found[name]}
    assert not wrong, "run python tests2/test_sizes.py; a package grows only where its goal is meant to hold it"
    above = {name for name, row in rows.items() if found[name] > row.get("part", row["goal"])}
    assert above == {name for name, row in rows.items() if row.get("above")}
    assert sum(row["goal"] for name, row in rows.items() if name != "tests2") <= 14_700
    assert all(row.get("part", 0) <= row["goal"] for row in rows.values())


if __name__ == "__main__":
    found = counted()
    row_of_package, text = r"(?m)^((\w+) = .*now = )\d+", SIZES.read_text()
    text = re.sub(row_of_package, lambda match: f"{match[1]}{found[match[2]]}", text)
    SIZES.write_text(text)
    for name, row in tomllib.loads(text).items():
        limit = row.get("part", row["goal"])
        print(f"{name:16} {found[name]:6} of {limit:6}" + f"  {found[name] - limit} above" * (found[name] > limit))  # noqa: T201
