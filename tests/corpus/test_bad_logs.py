"""Every bad log of the corpus ends as it should: refused with its code and nothing left, or used and the fault said."""

import json
import re
from pathlib import Path

import pytest

from archerfish.cli import identify_gimbal
from archerfish.records.plant import write_plant

from .bad_logs import FAULTS
from .ending import assert_refused, ended
from .recorded_axis import WORDS

DOCUMENTATION = Path(__file__).parents[2] / "docs" / "logs.md"
LEAVE_OUT = {"truncated", "late-input", "missing-values", "time-duplicate", "short-piece", "constant-input"}
"""Codes of repairs that leave samples out."""


@pytest.fixture
def no_pictures(monkeypatch):
    """Write the record only: the pictures are tested elsewhere, and would take most of the time."""

    def write(folder, command, evidence, *_, **__):
        write_plant(folder / f"{command.axis}.json", evidence.result.plant)

    monkeypatch.setattr(identify_gimbal, "_write_axis", write)


@pytest.mark.usefixtures("no_pictures")
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.make.__name__)
def test_a_log_ends_as_the_corpus_says(fault, tmp_path, capsys):
    logs, out = tmp_path / "logs", tmp_path / "out"
    logs.mkdir()
    words = [str(word) for word in [*fault.make(logs), "--out", out, "--json", tmp_path / "summary.json"]]
    order = WORDS[2:] if "--order" in words else WORDS
    status = ended("identify", "gimbal", *words, *order)
    printed = capsys.readouterr()
    if fault.outcome == "refused":
        assert_refused(status, printed, fault.code, out, tmp_path / "summary.json")
    else:
        assert status == 0, printed.err
        summary = json.loads((tmp_path / "summary.json").read_text())
        said = {(each["severity"], each["code"]) for each in summary["findings"]}
        assert ((fault.outcome, fault.code) in said) if fault.code else not said
        assert all(f"({severity}: {code})" in " ".join(printed.out.split()) for severity, code in said)
        assert_counted(summary, printed.out.splitlines()[0], fault)
        if fault.outcome in ("accepted", "repaired"):
            # A repair that is certain leaves the axis as it was: it follows its command.
            assert summary["dc_gain"] == pytest.approx([1.0], abs=0.05)
            assert min(each["fit_percent"] for each in summary["training"]) > 95


def assert_counted(summary, headline, fault):
    """Check that what was left out of the logs is counted by its reason, and said in the first line."""
    samples = summary["samples"]
    assert samples["held"] - samples["used"] == sum(samples["left_out"].values())
    assert sum(each["samples"] for each in summary["findings"]) == sum(samples["left_out"].values())
    assert (fault.code in samples["left_out"]) == (fault.outcome == "repaired" and fault.code in LEAVE_OUT)
    assert ("samples used" in summary["headline"]) == bool(samples["left_out"])
    assert summary["headline"].startswith(headline)
    if samples["left_out"]:
        assert f"; {samples['used']} of {samples['held']} samples used" in summary["headline"]


def test_the_table_of_codes_lists_what_the_corpus_shows():
    rows = re.findall(r"^\| `([\w-]+)` \| ([\w, ]+) \|", DOCUMENTATION.read_text(), re.MULTILINE)
    listed = {(code, outcome) for code, outcomes in rows for outcome in outcomes.split(", ")}
    assert listed == {(fault.code, fault.outcome) for fault in FAULTS if fault.code}
