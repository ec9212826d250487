"""The names of `import archerfish2 as af`, and the ten lines of the page of evaluation."""

import re
from pathlib import Path

import pytest

import archerfish2 as af

ROOT = Path(__file__).parents[1]


def test_the_front_door_has_few_names_which_all_load():
    assert dir(af) == sorted(name for name in af.__all__ if hasattr(af, name))
    assert len(af.__all__) <= 25
    with pytest.raises(AttributeError, match=r"'archerfish2' has no attribute 'evalute'; it has .*evaluate"):
        _ = af.evalute


def test_ten_lines_lead_to_results(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("archerfish2.evaluation.tuning.rates", lambda *_: lambda settings: 0.5)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    monkeypatch.chdir(tmp_path)
    lines, later = re.findall(r"```python\n(.*?)```", (ROOT / "docs2" / "evaluation.md").read_text(), re.DOTALL)[:2]
    exec(lines.replace("./examples2", f"{ROOT}/examples2").replace("engagements=100", "engagements=4") + later, {})
    assert re.search(r"ours − kalman.*\n.*ours static \(2\.0, 3\.0\) \d+ of 200 ", capsys.readouterr().out, re.DOTALL)
    assert {each.name for each in tmp_path.iterdir()} == {"rates.png", "my-evaluation", "report.html"}
