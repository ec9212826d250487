"""Lines of code by package, and their width, against sizes.toml; `python tests/test_sizes.py` writes what is there.

The width is the number of characters in a line of code, without spaces, on average: code that is squeezed into fewer,
wider lines is not less.
"""

import ast
import collections
import io
import re
import tokenize
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
SIZES = ROOT / "tests" / "sizes.toml"
LEAVES = "__init__ __main__ errors arrays storage provenance workers compiled plugins object_digest"
GROUP = dict.fromkeys(LEAVES.split(), "leaves") | dict.fromkeys(("robot", "task", "messages"), "nouns")


def code_size(source: str) -> tuple[int, int]:
    """Count lines, and characters without spaces, of what is left without blank lines, comments and docstrings."""
    empty = (tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER)
    tokens = [token for token in tokenize.generate_tokens(io.StringIO(source).readline) if token.type not in empty]
    docstrings = set[int]()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str):
            docstrings.update(range(node.lineno, node.end_lineno + 1))
    code = [token for token in tokens if token.start[0] not in docstrings]
    lines = {line for token in code for line in range(token.start[0], token.end[0] + 1)}
    return len(lines), sum(len("".join(token.string.split())) for token in code)


def counted() -> tuple[dict[str, int], dict[str, float]]:
    """Return package → lines of code, and → characters a line; the tests without the comparison with the first one."""
    lines, characters = collections.Counter(), collections.Counter()
    for path in [*(ROOT / "src" / "archerfish").rglob("*.py"), *(ROOT / "tests").rglob("*.py")]:
        here = path.relative_to(ROOT).with_suffix("").parts
        name = "tests" if here[0] == "tests" else GROUP.get(here[2], here[2])
        if "against_first" not in here:
            size = code_size(path.read_text())
            lines[name] += size[0]
            characters[name] += size[1]
    return lines, {name: round(characters[name] / max(lines[name], 1), 1) for name in lines}


def test_sizes_are_those_of_the_code_and_below_their_limits_but_where_the_table_says_so() -> None:
    source = '"""M.\n\nN."""\n\nimport a  # why\n# note\ndef f():\n """F."""\n return """x\n\n y"""\n'
    assert code_size(source) == (5, len("importa" + "deff():" + 'return"""xy"""'))
    rows, (found, widths) = tomllib.loads(SIZES.read_text()), counted()
    limits = rows.pop("width")
    assert found.keys() <= rows.keys(), "give each package a goal in tests/sizes.toml"
    wrong = {name: found[name] for name, row in rows.items() if row.get("now", found[name]) != found[name]}
    assert not wrong, "run python tests/test_sizes.py; a package grows only where its goal is meant to hold it"
    above = {name for name, row in rows.items() if found[name] > row.get("part", row["goal"])}
    assert above == {name for name, row in rows.items() if row.get("above")}
    planned_later = rows["safety"]["goal"]  # came after the plan of the house
    assert sum(row["goal"] for name, row in rows.items() if name != "tests") - planned_later <= 14_700
    assert all(row.get("part", 0) <= row["goal"] for row in rows.values())
    assert {name: width for name, width in widths.items() if width > limits[name]} == {}, (
        "wider lines are not less code"
    )


if __name__ == "__main__":
    found, widths = counted()
    row_of_package, text = r"(?m)^((\w+) = .*now = )\d+", SIZES.read_text()
    text = re.sub(row_of_package, lambda match: f"{match[1]}{found[match[2]]}", text)
    SIZES.write_text(text)
    rows = tomllib.loads(text)
    limits = rows.pop("width")
    for name, row in rows.items():
        limit = row.get("part", row["goal"])
        above = f"  {found[name] - limit} above" * (found[name] > limit)
        print(f"{name:16} {found[name]:6} of {limit:6}, width {widths.get(name, 0):4} of {limits[name]}{above}")  # noqa: T201
