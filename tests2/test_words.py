"""Plain standard English in sources and pages, and one meaning for each public name."""

import ast
import collections
import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = {path: path.read_text() for path in sorted((ROOT / "src" / "archerfish2").rglob("*.py"))}
TEXT = re.compile(
    r"(?i)\b(told|hears?|heard|foretell\w*|foretold|anew|whom|wish(es|ed)?|fights?|fought"
    r"|(entrant|rival|workbench|stand-in|sighting)(e?s)?)\b"
)
"""Words that stand in no text; the help of a command is text of its source."""
PARTS = {"way", "chance", "sight", "bench", "standing", "ground"}
"""Words that are no part of an identifier."""


def in_text(text: str) -> list[str]:
    """Return the words of a text, identifiers taken apart, that should not be there."""
    return [match[0] for match in TEXT.finditer(text.replace("_", " "))]


def in_name(name: str) -> bool:
    """Whether an identifier has such a part; the line of sight is a standard term."""
    parts = re.findall("[A-Z]?[a-z]+|[A-Z]+(?![a-z])", re.sub("(?i)line_?of_?sight", "", name))
    return not PARTS.isdisjoint(part.lower().removesuffix("s") for part in parts)


def test_texts_are_plain_english() -> None:
    pages = {path: path.read_text() for path in (ROOT / "docs2").rglob("*.md")}
    assert {str(path): words for path, text in (SOURCES | pages).items() if (words := in_text(text))} == {}


def test_identifiers_are_technical_terms() -> None:
    for path, source in SOURCES.items():
        tokens = tokenize.generate_tokens(io.StringIO(source).readline)
        names = {each.string for each in tokens if each.type == tokenize.NAME} | {path.stem, path.parent.name}
        assert not list(filter(in_name, names)), path


def test_a_public_name_has_one_meaning() -> None:
    places = collections.defaultdict(set)
    for path, source in SOURCES.items():
        for node in ast.parse(source).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                places[node.name].add(path)
    assert {name: paths for name, paths in places.items() if len(paths) > 1} == {}


def test_words_are_found_in_a_text_and_as_parts_of_a_name() -> None:
    assert len(in_text("The filter was told Anew. when_heard = 1; two stand-ins, a rival; retold")) == 5
    assert all(map(in_name, ("hit_chance", "HitChance", "ways", "SIGHT")))
    assert not any(map(in_name, ("line_of_sight", "LineOfSight", "background", "always")))
