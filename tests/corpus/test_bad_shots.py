"""Every bad file of shots ends as it should: refused with its code and nothing left, or used and the fault said."""

import json
import re
from pathlib import Path

import pytest

from archerfish.cli import identify_muzzle

from .bad_shots import FAULTS
from .ending import assert_refused, ended

DOCUMENTATION = Path(__file__).parents[2] / "docs"


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.make.__name__)
def test_shots_end_as_the_corpus_says(fault, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(identify_muzzle, "save_figure", lambda path, _: path.touch())  # pictures take most of the time
    files, out = tmp_path / "shots", tmp_path / "out"
    files.mkdir()
    words = [str(word) for word in [*fault.make(files), "--out", out, "--json", tmp_path / "summary.json"]]
    status = ended("identify", "muzzle", *words)
    printed = capsys.readouterr()
    if fault.outcome == "refused":
        assert_refused(status, printed, fault.code, out, tmp_path / "summary.json")
    else:
        assert status == 0, printed.err
        found = json.loads((tmp_path / "summary.json").read_text())["findings"]
        assert fault.code in {each["code"] for each in found}


def test_every_code_that_the_corpus_shows_is_documented():
    text = (DOCUMENTATION / "shots.md").read_text() + (DOCUMENTATION / "logs.md").read_text()
    assert {fault.code for fault in FAULTS} <= set(re.findall(r"^\| `([\w-]+)` \|", text, re.MULTILINE))
