"""The documentation holds: its Python runs, its command lines are understood, its links lead somewhere."""

import re
import shlex
import tempfile
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.main import COMMANDS, load
from archerfish.cli.parsing import parse
from archerfish.deployment.export import export_policy
from archerfish.records.policy import PolicyRecord, write_policy

ROOT = Path(__file__).parents[1]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md")])
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


EXPORTED = "infantry.onnx"
"""What a page may take for granted: an exported policy."""


def write_exported(path: Path) -> None:
    """Export a tracked policy that has learned nothing, and leave its record nowhere."""
    noise = {"acceleration": 3.0, "along": 0.001, "across": 0.001, "along_share": 0.015, "across_angle": 0.002}
    size = 55
    record = PolicyRecord(
        observation="tracked",
        frames=4,
        weights=(np.zeros((size, 2), np.float32),),
        biases=(np.zeros(2, np.float32),),
        mean=np.zeros(size, np.float32),
        variance=np.ones(size, np.float32),
        action_scale=np.array([0.03, 0.1], np.float32),
        braking=np.array([0.02, 0.02], np.float32),
        muzzle={"speed": 18.0, "drag": 0.019, "length": 0.16, "pitch_offset": 0.0, "yaw_offset": 0.0},
        period_s=0.02,
        command_limit="gate",
        tracker=noise,
    )
    with tempfile.TemporaryDirectory() as folder:
        write_policy(Path(folder) / "policy.json", record)
        export_policy(Path(folder) / "policy.json", path)


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a page in one language."""
    return [text for kind, text in FENCE.findall(page.read_text()) if kind == language]


def command_lines(page: Path) -> list[str]:
    """Return the lines of a page's shell blocks that run archerfish, continued ones joined, without comments."""
    joined = "\n".join([*blocks(page, "sh"), *blocks(page, "")]).replace("\\\n", " ")
    return [line.partition("#")[0].strip() for line in joined.splitlines() if line.startswith("archerfish ")]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", FENCE.sub("", page.read_text()))
    assert [link for link in links if not (page.parent / link).exists()] == []


@pytest.mark.parametrize("line", sorted({line for page in PAGES for line in command_lines(page)}))
def test_command_lines_are_understood(line: str) -> None:
    words = shlex.split(line)[1:]
    if words in (["--help"], ["--version"]):
        return
    name = next(name for name in COMMANDS if words[: len(name.split())] == name.split())
    kind, _ = load(name)
    assert isinstance(parse(kind, name, words[len(name.split()) :]), kind)


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.name)
def test_python_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = "\n".join(blocks(page, "python"))
    for needed in ("jax",) * ("evaluation" in script) + ("jax", "gymnasium") * ("gymnasium" in script):
        pytest.importorskip(needed)
    for needed in ("onnx", "onnxruntime") * (EXPORTED in script):
        pytest.importorskip(needed)
    runnable = [text for text in blocks(page, "python") if "open(" not in text]  # files of a run that is not here
    monkeypatch.chdir(tmp_path)
    if EXPORTED in script:
        write_exported(tmp_path / EXPORTED)
    given = list(tmp_path.iterdir())
    exec(compile("\n".join(runnable), str(page), "exec", dont_inherit=True), {"__name__": page.stem})
    assert list(tmp_path.iterdir()) == given


def test_every_page_is_in_the_navigation() -> None:
    named = set(re.findall(r"[\w]+\.md", (ROOT / "mkdocs.yml").read_text()))
    assert named == {page.name for page in ROOT.glob("docs/*.md")}


def test_readme_prints_what_it_says(capsys: pytest.CaptureFixture[str]) -> None:
    script = "\n".join(blocks(ROOT / "README.md", "python"))
    exec(compile(script, "README.md", "exec", dont_inherit=True), {})
    promised = re.findall(r"print\(.*\)  # ([\d.]+?)(?:\.\.\.)?$", script, re.MULTILINE)
    printed = capsys.readouterr().out.splitlines()
    assert promised
    assert all(line.startswith(start) for line, start in zip(printed, promised, strict=True))
