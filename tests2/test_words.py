"""Plain standard English in sources and pages, and one meaning for each public name."""

import ast
import collections
import io
import re
import tokenize
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src" / "archerfish2").rglob("*.py"))
TEXT = re.compile(
    r"\b(told|hears?|heard|foretell\w*|foretold|anew|whom|wish(es|ed)?|fights?|fought"
    r"|(entrant|rival|workbench|stand-in|sighting)(e?s)?)\b",
    re.IGNORECASE,
)
"""Words that stand in no text; the help of a command is text of its source."""
PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
PARTS = {"way", "chance", "sight", "bench", "standing", "ground"}
"""Words that are no part of an identifier."""


def in_text(text: str) -> list[str]:
    """Return the words of a text, identifiers taken apart, that should not be there."""
    return [match[0] for match in TEXT.finditer(text.replace("_", " "))]


def in_names(names: set[str]) -> list[str]:
    """Return the identifiers that have such a part; the line of sight is a standard term."""
    words = {each: PART.findall(re.sub("line_?of_?sight", "", each, flags=re.IGNORECASE)) for each in names}
    return sorted(name for name in names if PARTS & {word.lower().removesuffix("s") for word in words[name]})


def identifiers(path: Path) -> set[str]:
    """Return the names in a module, and its own."""
    tokens = tokenize.generate_tokens(io.StringIO(path.read_text()).readline)
    return {each.string for each in tokens if each.type == tokenize.NAME} | {path.stem, path.parent.name}


def test_texts_are_plain_english() -> None:
    found = {path: in_text(path.read_text()) for path in [*SOURCES, *(ROOT / "docs2").rglob("*.md")]}
    assert {str(path.relative_to(ROOT)): words for path, words in found.items() if words} == {}


def test_identifiers_are_technical_terms() -> None:
    found = {path: in_names(identifiers(path)) for path in SOURCES}
    assert {str(path.relative_to(ROOT)): names for path, names in found.items() if names} == {}


def test_a_public_name_has_one_meaning() -> None:
    places = collections.defaultdict(list)
    for path in SOURCES:
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(ROOT)))
    assert {name: paths for name, paths in places.items() if len(set(paths)) > 1} == {}


def test_words_are_found_in_a_text_and_as_parts_of_a_name() -> None:
    assert len(in_text("The filter was told Anew. when_heard = 1; two stand-ins, a rival; retold")) == 5
    names = {"hit_chance", "HitChance", "ways", "SIGHT", "line_of_sight", "LineOfSight", "background", "always"}
    assert in_names(names) == sorted({"hit_chance", "HitChance", "ways", "SIGHT"})
