"""The documentation holds: its command lines are understood as they are written, and its pages are complete."""

import re
import shlex
from pathlib import Path

import pytest

from archerfish.cli.main import COMMANDS, load
from archerfish.cli.parsing import parse

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a page in one language."""
    return [text for kind, text in FENCE.findall(page.read_text()) if kind == language]


def command_lines(page: Path) -> list[str]:
    """Return the lines of a page's shell blocks that run archerfish, continued ones joined, without comments."""
    joined = "\n".join([*blocks(page, "sh"), *blocks(page, "")]).replace("\\\n", " ")
    return [line.partition("#")[0].strip() for line in joined.splitlines() if line.startswith("archerfish ")]


@pytest.mark.parametrize("line", sorted({line for page in PAGES for line in command_lines(page)}))
def test_command_lines_are_understood(line: str) -> None:
    words = shlex.split(line)[1:]
    if words in (["--help"], ["--version"]):
        return
    name = next(name for name in COMMANDS if words[: len(name.split())] == name.split())
    kind, _ = load(name)
    assert isinstance(parse(kind, name, words[len(name.split()) :]), kind)


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w/]+\.md", (ROOT / "mkdocs.yml").read_text()))
    assert named == {str(page.relative_to(ROOT / "docs")) for page in ROOT.glob("docs/**/*.md")}


def test_every_package_has_a_page_of_its_api_and_every_benchmark_a_line() -> None:
    packages = {path.parent.name for path in (ROOT / "src" / "archerfish").glob("*/__init__.py")} - {"cli"}
    assert {
        path.stem: re.findall(r"^::: (\S+)$", path.read_text(), re.MULTILINE) for path in ROOT.glob("docs/api/*.md")
    } == {name: [f"archerfish.{name}"] for name in packages}
    scripts = {str(path.relative_to(ROOT)) for path in ROOT.glob("benchmarks/*.py") if "__main__" in path.read_text()}
    assert set(re.findall(r"`python (benchmarks/\w+\.py)`", (ROOT / "docs" / "benchmarks.md").read_text())) == scripts


def test_readme_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    script = "\n".join(blocks(ROOT / "README.md", "python"))
    exec(compile(script, "README.md", "exec", dont_inherit=True), {})
    promised = re.findall(r"print\(.*\)  # ([\d.]+?)(?:\.\.\.)?$", script, re.MULTILINE)
    printed = capsys.readouterr().out.splitlines()
    assert promised
    assert all(line.startswith(start) for line, start in zip(printed, promised, strict=True))
