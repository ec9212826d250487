import hashlib
import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from archerfish import __version__
from archerfish.records.provenance import code_commit, library_versions, provenance


def test_it_names_seed_commit_versions_and_the_hash_of_every_input(tmp_path: Path) -> None:
    (tmp_path / "log.csv").write_bytes(b"time_s\n")
    found = provenance(7, [tmp_path / "log.csv"])
    assert found["seed"] == 7
    assert found["inputs"] == {"log.csv": hashlib.sha256(b"time_s\n").hexdigest()}
    assert found["commit"] == code_commit()
    assert found["versions"]["archerfish"] == __version__
    assert json.loads(json.dumps(found)) == found


def test_versions_are_those_that_run() -> None:
    assert library_versions()["numpy"] == np.__version__


@pytest.mark.parametrize("failure", [FileNotFoundError("git"), subprocess.TimeoutExpired("git", 10)])
def test_without_a_checkout_the_commit_is_unknown(monkeypatch: pytest.MonkeyPatch, failure: Exception) -> None:
    def fail(*arguments: object, **options: object) -> None:
        raise failure

    monkeypatch.setattr(subprocess, "run", fail)
    assert code_commit.__wrapped__() == "unknown"
