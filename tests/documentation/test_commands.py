"""Every command of every page runs, in the page's order and in a folder of its own, made short."""

import shlex
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from archerfish.cli import evaluation_run
from archerfish.cli.live_run import LiveRun
from archerfish.cli.main import main
from archerfish.figures import style

from . import laboratory
from .pages import ALL, PAGES, Block, blocks
from .shortened import shortened

NEEDS = {"train": ("jax",), "evaluate": ("jax",), "sweep": ("jax",), "logs.md": ("rosbags",)}
"""First word of a command, or page → libraries without which it can't run."""


def run_blocks(page: Path) -> list[Block]:
    return [each for each in blocks(page) if each.language == "sh" and not each.reason]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder with what the pages' readers have."""
    folder = tmp_path_factory.mktemp("laboratory")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        laboratory.make(folder)
    return folder


@pytest.fixture(scope="module", autouse=True)
def quick_compilation() -> Iterator[None]:
    """Let compilers optimise little: these programs run for a moment only."""
    if find_spec("jax") is None:
        yield
        return
    import jax

    jax.config.update("jax_disable_most_optimizations", True)
    yield
    jax.config.update("jax_disable_most_optimizations", False)


@pytest.fixture(scope="module", autouse=True)
def one_picture() -> Iterator[None]:
    """Draw the first picture of each format and take it for all others: drawing is most of an identification's time."""
    drawn: dict[str, bytes] = {}

    def rendered(figure: Figure, kind: str) -> bytes:
        return drawn[kind] if kind in drawn else drawn.setdefault(kind, really(figure, kind))

    really = style._rendered
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "_rendered", rendered)
        yield


@pytest.mark.parametrize("page", [page for page in PAGES if run_blocks(page)], ids=lambda page: page.name)
def test_the_commands_of_a_page_run(
    page: Path, made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [(block, line) for block in run_blocks(page) for line in block.commands]
    assert [f"{block.place}: {line}" for block, line in lines if not line.startswith("archerfish ")] == []
    for needed in {each for _, line in lines for name in (line.split()[1], page.name) for each in NEEDS.get(name, ())}:
        pytest.importorskip(needed)
    monkeypatch.chdir(tmp_path)
    # A tuned controller is the same program under other numbers; how many engagements it is tuned on is not shown here.
    monkeypatch.setattr(evaluation_run, "TUNING_ENGAGEMENTS", 1)
    for lay in laboratory.GIVEN.get(page.name, ()):
        lay(made, tmp_path)
    for block, line in lines:
        words = shortened(shlex.split(line)[1:], sampler=find_spec("optuna") is not None)
        if "--resume" in words:
            break_off(lines, line)
        try:
            main(words)
        except SystemExit as ended:
            told = capsys.readouterr()
            assert not ended.code, f"{block.place}: {line}\nas {' '.join(words)}\n{told.out}{told.err}"


def break_off(lines: list[tuple[Block, str]], resumed: str) -> None:
    """Begin the training that a later command goes on with, and end it as Ctrl-C does."""
    began = next(line for _, line in lines if line.split()[1] == "train" and "--resume" not in line)

    def interrupted(live: LiveRun, standing: object) -> None:
        live._requests.number = 2
        watch(live, standing)

    watch = LiveRun.watch
    with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit):
        patch.setattr(LiveRun, "watch", interrupted)
        main(shortened(shlex.split(began)[1:]))


def test_pages_that_are_given_something_exist_and_have_commands() -> None:
    assert laboratory.GIVEN.keys() <= {each.page.name for each in ALL if each.language == "sh" and not each.reason}


def test_commands_are_shortened_where_the_page_has_the_option_and_where_not() -> None:
    words = shlex.split("evaluate p.json --controllers kalman oracle ./a.py:Mine --robot me --engagements 400")
    expected = "evaluate p.json --robot me --engagements 2 --controllers kalman ./a.py:Mine"
    assert " ".join(shortened(words)) == expected
    assert shortened(["identify", "muzzle", "shots.csv"]) == ["identify", "muzzle", "shots.csv"]
    assert shortened(["train", "--resume", "runs/train"]) == ["train", "--resume", "runs/train"]
