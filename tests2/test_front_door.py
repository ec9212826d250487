"""The names of `import archerfish2 as af`, and the ten lines of the page of evaluation."""

import re
import shutil
import textwrap
from pathlib import Path

import pytest

import archerfish2 as af
from archerfish2.learning.config import GradientConfig

ROOT = Path(__file__).parents[1]


def test_the_front_door_has_few_names_which_all_load():
    assert dir(af) == sorted(name for name in af.__all__ if hasattr(af, name))
    assert len(af.__all__) <= 25
    with pytest.raises(AttributeError, match=r"'archerfish2' has no attribute 'evalute'; it has .*evaluate"):
        _ = af.evalute


@pytest.mark.parametrize("robots", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_the_readme_trains_and_evaluates_for_the_paper_s_robot_and_for_a_folder(robots, monkeypatch, tmp_path, capsys):
    pytest.importorskip("gymnasium")
    monkeypatch.setattr("archerfish2.evaluation.tuning.rates", lambda *_: lambda settings: 0.5)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "tests2" / "infantry", "my-robot")
    section = (ROOT / "README.md").read_text().partition("## From Python")[2].partition("The first edition's parts")[0]
    blocks = [
        textwrap.dedent(each) for each in re.findall(r"^ ```python\n(.*?)^ ```", section, re.MULTILINE | re.DOTALL)
    ]
    assert (len(blocks), sum(each.count("\n") for each in blocks[:2])) == (3, 10)
    # As small as in the other tests, whose programs it shares.
    small = GradientConfig(environments=32, hidden=16, window=5, steps=640)
    monkeypatch.setattr("archerfish2.learning.train.with_given", lambda config, *_: config.replace(gradient=small))
    exec("".join([*blocks[:robots], blocks[2]]).replace("engagements=100", "engagements=4"), {})
    assert re.search(
        "policy − kalman.*\npolicy −" if robots > 1 else "policy − kalman", capsys.readouterr().out, re.DOTALL
    )
    assert robots == 1 or {"policy.safetensors", "curve.svg"} <= {
        each.name for each in (tmp_path / "my-robot" / "policy").iterdir()
    }


def test_ten_lines_lead_to_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("archerfish2.evaluation.tuning.rates", lambda *_: lambda settings: 0.5)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    lines, later = re.findall(r"```python\n(.*?)```", (ROOT / "docs2" / "evaluation.md").read_text(), re.DOTALL)[:2]
    exec(lines.replace("./examples2", f"{ROOT}/examples2").replace("engagements=100", "engagements=4") + later, {})
    assert re.search(r"ours − kalman.*\n.*ours static \(2\.0, 3\.0\) \d+ of 200 ", capsys.readouterr().out, re.DOTALL)
    assert {each.name for each in tmp_path.iterdir()} == {"rates.png", "my-evaluation", "report.html"}
