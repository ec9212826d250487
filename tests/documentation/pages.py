"""The pages, and the fenced blocks in them: their language, and why one is not run, if a comment before it says so."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
RUN = ("sh", "python")
"""Languages of blocks that are run."""
SHOWN = ("text", "json", "toml", "csv")
"""Languages of blocks that show something: output and files."""

_BLOCK = re.compile(
    r"(?:<!-- (?P<mark>[^>]*?) -->\n\n?)?^```(?P<language>\w*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)
_MARK = re.compile(r"not run: (\S.*)", re.DOTALL)


class Block(NamedTuple):
    """A fenced block."""

    page: Path
    line: int
    language: str
    text: str
    reason: str
    """Why it is not run; empty where it is."""

    @property
    def place(self) -> str:
        """Page and line."""
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    @property
    def commands(self) -> list[str]:
        """Lines of a shell block, continued ones joined, without comments."""
        lines = [line.partition("#")[0].strip() for line in self.text.replace("\\\n", " ").splitlines()]
        return [line for line in lines if line]


def blocks_in(page: Path, text: str) -> list[Block]:
    """Return the fenced blocks of a page."""
    found = []
    for match in _BLOCK.finditer(text):
        reason = _MARK.fullmatch(match["mark"] or "")
        line = text.count("\n", 0, match.start("language")) + 1
        found.append(Block(page, line, match["language"], match["text"], " ".join(reason[1].split()) if reason else ""))
    return found


def blocks(page: Path) -> list[Block]:
    """Return the fenced blocks of a page."""
    return blocks_in(page, page.read_text())


ALL = [block for page in PAGES for block in blocks(page)]


def without_blocks(text: str) -> str:
    """Return a page's text without its fenced blocks and comments."""
    return re.sub(r"^```.*?^```$|<!--.*?-->", "", text, flags=re.MULTILINE | re.DOTALL)
