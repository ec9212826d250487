"""The pages: what is made from scripts is up to date and runs, links lead somewhere, and there are few lines."""

import importlib
import json
import re
import runpy
import shlex
from pathlib import Path

import pytest

from archerfish.cli.main import COMMANDS, main
from archerfish.learning.config import GradientConfig

ROOT = Path(__file__).parents[1]
PAGES = {path: path.read_text() for path in (*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md")))}


def anchors(text):
    """Return the anchors of a page's headings, as GitHub and the site make them."""
    headings = re.findall(r"^#+ (.*)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_what_is_made_from_scripts_is_up_to_date():
    made = runpy.run_path(str(ROOT / "docs" / "make_pages.py"))["made"]()
    stale = [path.name for path, text in made.items() if not path.exists() or path.read_text() != text]
    assert stale == [], "python docs/make_pages.py"


def test_links_lead_to_files_and_headings():
    wrong = []
    for page, text in PAGES.items():
        for link in re.findall(r"\]\((?!https?:)([^)\s]+)\)", text):
            file, _, anchor = link.partition("#")
            path = page.parent / file if file else page
            if not path.exists() or (anchor and anchor not in anchors(path.read_text())):
                wrong.append((page.name, link))
    assert wrong == []


def test_commands_of_pages_and_help_are_understood(monkeypatch):
    commands = [getattr(importlib.import_module(module), options) for module, options in COMMANDS.values()]
    run = list[type]()
    for command in commands:
        monkeypatch.setattr(command, "run", lambda command, _: run.append(type(command)))
    texts = [text.replace("\\\n", " ") for text in (*PAGES.values(), *(command.__doc__ for command in commands))]
    typed = [line for text in texts for line in re.findall(r"^ *(?:\$ )?archerfish (.+)$", text, re.MULTILINE)]
    for line in typed:
        main(shlex.split(line, comments=True))
    assert len(run) == len(typed)
    assert {*run} == {*commands}


@pytest.mark.parametrize(
    "number", [pytest.param(2, marks=pytest.mark.slow), 3, pytest.param(4, marks=pytest.mark.slow)]
)
def test_a_tutorial_runs(number, tmp_path, monkeypatch, capsys):
    pytest.importorskip("mujoco" if number == 4 else "jax")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    [script] = (ROOT / "examples").glob(f"tutorial_{number}_*.py")
    small = re.sub(r"engagements=\d+", "engagements=8", script.read_text()).replace("300_000", "20_000")
    exec(compile(small, str(script), "exec"), {"__name__": "tutorial"})
    assert re.search(
        {2: r"policy − kalman", 3: r"dynamic targets: ", 4: r"% on the virtual robot"}[number], capsys.readouterr().out
    )


@pytest.mark.slow
def test_the_ten_lines_of_readme_run(tmp_path, monkeypatch, capsys):
    pytest.importorskip("jax")
    monkeypatch.chdir(tmp_path)
    [lines] = re.findall(r"```python\n(.*?)```", PAGES[ROOT / "README.md"], re.DOTALL)
    # As small as in the other tests, whose programs it shares.
    small = GradientConfig(environments=32, hidden=16, window=5, steps=640)
    monkeypatch.setattr("archerfish.learning.train.with_given", lambda config, *_: config.replace(gradient=small))
    exec(lines.replace("engagements=100", "engagements=4"), {})
    assert re.search(r"policy − kalman.*of 200 shots hit.*policy.c decides", capsys.readouterr().out, re.DOTALL)
    assert {path.name for path in tmp_path.iterdir()} == {"rates.png", "policy.c", "policy.h"}


def test_the_table_of_readme_is_what_is_stored():
    stored = json.loads((ROOT / "benchmarks" / "results" / "readme.json").read_text())["percent"]
    rates = {tuple(row["range_m"]): [] for row in stored}
    for row in stored:
        if row["targets"] == "dynamic":
            rates[tuple(row["range_m"])].append(f"{row['rate']:.1f} ({row['low']:.1f}–{row['high']:.1f})")
    for (low, high), cells in rates.items():
        assert f"| {low:g}–{high:g} m | {' | '.join(cells)} |" in PAGES[ROOT / "README.md"].replace("*", "")
