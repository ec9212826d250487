"""Every block is run, or says why not."""

import re
from pathlib import Path

import pytest

from . import laboratory
from .pages import ALL, PAGES, ROOT, RUN, SHOWN, Block, blocks, blocks_in


def by_place(block: Block) -> str:
    return block.place


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_has_a_language_that_says_whether_it_is_run(page: Path) -> None:
    assert len(blocks(page)) == len(re.findall(r"^```", page.read_text(), re.MULTILINE)) / 2
    assert [each.place for each in blocks(page) if each.language not in (*RUN, *SHOWN)] == []
    assert [each.place for each in blocks(page) if each.language in SHOWN and each.reason] == []


def test_no_mark_is_without_its_block() -> None:
    marks = sum(len(re.findall(r"^<!-- not run", page.read_text(), re.MULTILINE)) for page in PAGES)
    assert marks == sum(bool(each.reason) for each in ALL)


@pytest.mark.parametrize("block", [each for each in ALL if each.reason], ids=by_place)
def test_of_the_others_the_reason_is_told(block: Block) -> None:
    named = re.findall(r"(?:tests|benchmarks)/[\w/]+\.py", block.reason)
    assert [each for each in named if not (ROOT / each).is_file()] == []
    pytest.skip(f"{block.place} is not run: {block.reason}")


def test_a_mark_belongs_to_the_block_below_it_and_needs_a_reason() -> None:
    def reasons(text: str) -> list[str]:
        return [each.reason for each in blocks_in(ROOT / "README.md", text)]

    assert reasons("<!-- not run: needs a\nrobot -->\n```sh\nx\n```\n\n```sh\ny\n```\n") == ["needs a robot", ""]
    assert reasons("<!-- not run: needs a robot -->\n\n```sh\nx\n```\n") == ["needs a robot"]
    assert reasons("<!-- not run: needs a robot -->\nwords\n```sh\nx\n```\n") == [""]
    assert reasons("<!-- not run: -->\n```sh\nx\n```\n") == [""]


PYTHON = [page for page in PAGES if any(each.language == "python" and not each.reason for each in blocks(page))]


@pytest.mark.parametrize("page", PYTHON, ids=lambda page: page.name)
def test_python_runs(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = "\n".join(each.text for each in blocks(page) if each.language == "python" and not each.reason)
    for needed in ("jax",) * ("evaluation" in script) + ("jax", "gymnasium") * ("gymnasium" in script):
        pytest.importorskip(needed)
    for needed in ("onnx", "onnxruntime") * ("onnxruntime" in script):
        pytest.importorskip(needed)
    for lay in laboratory.GIVEN_TO_PYTHON.get(page.name, ()):
        lay(tmp_path, tmp_path)
    given = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    exec(compile(script, str(page), "exec", dont_inherit=True), {"__name__": page.stem})
    assert sorted(tmp_path.rglob("*")) == given
