"""Sweeps: their tables, what is left of them when they are killed, and what they refuse."""

import contextlib
import csv
import json
import math
import multiprocessing
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import archerfish as af
from archerfish import storage
from archerfish.cli.main import main
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.learning.config import TrainConfig
from archerfish.reports.report import Report
from archerfish.studies import sweep as module
from archerfish.studies.sweep import sweep
from archerfish.studies.sweep_results import pooled_settings
from archerfish.studies.sweep_trial import HITS, TrialHits, train_and_count

pytest.importorskip("jax")
pytest.importorskip("optuna")
SMALL = {"environments": 32, "hidden": 16, "rollout": 5, "minibatches": 2, "epochs": 1, "steps": 32 * 5 * 12}
RANGES = {"gradient.learning_rate": "1e-4..1e-1:log", "frames": "2..5", "reward": "eq-8,smooth-hit"}
SEARCH = {"task": "paper", "vary": RANGES, "trials": 9, "batch": 3, "seeds": 2, "engagements": 2, "workers": 2}


def computed(*, parameters, seed, folder, **_):
    """Write hits that are a function of the settings, in the place of a training."""
    time.sleep(0.01)
    rate = parameters.get("gradient.learning_rate", 1e-2)
    hits = int(40 - 8 * abs(math.log10(rate) + 2.5)) - seed + parameters.get("frames", 0)
    with (folder.parents[1] / "trained").open("a") as stream:
        stream.write(f"{folder.name}\n")
    TrialHits(hits=((hits, hits - 1), (hits, hits)), decisions=(50, 50)).save(folder / HITS)


def sweep_elsewhere(out):
    module.train_and_count = computed
    sweep(**SEARCH, out=out)


def dies_once(*, folder, **given):
    """Train, but in the first process that comes here."""
    mark = Path(os.environ["ARCHERFISH_TEST_MARK"])
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    train_and_count(folder=folder, **given)


@pytest.fixture
def at_once(monkeypatch):
    """Compute hits in this process, in the place of trainings in others."""
    monkeypatch.setattr(module, "train_and_count", computed)
    monkeypatch.setattr(Report, "write_page", lambda *_: None)
    monkeypatch.setattr(module, "run_jobs", lambda _, jobs, __: [job.function(**job.arguments) for job in jobs])


@pytest.fixture
def undisturbed(at_once, tmp_path):
    sweep(**SEARCH, out=tmp_path / "undisturbed")
    return (tmp_path / "undisturbed" / "results.csv").read_text()


def test_values_are_combined_in_their_order_and_each_setting_is_pooled(at_once, tmp_path):
    swept = sweep(task="paper", vary={"frames": [4, 2], "gradient.anneal": "true,false"}, seeds=2, out=tmp_path)
    expected = [(4, True), (4, False), (2, True), (2, False)]
    rows = list(csv.DictReader((tmp_path / "results.csv").read_text().splitlines()))
    assert [(int(row["frames"]), row["gradient.anneal"] == "True") for row in rows] == expected
    assert [(int(row["hits"]), int(row["decisions"])) for row in rows] == [(314, 400)] * 2 + [(298, 400)] * 2
    assert (swept.best.number, (tmp_path / "best" / HITS).exists()) == (0, True)


def test_the_interval_is_of_engagements_and_of_seeds_pooled_over_settings():
    draws = np.random.default_rng(0)
    hits = draws.integers(20, 50, (3, 2, 5)).tolist()  # setting, seed, engagement
    found = [[TrialHits(hits=[own], decisions=[50]) for own in seeds] for seeds in hits]
    rates = np.mean(hits, axis=2) / 50
    half_width = stats.t.ppf(0.975, 3) * math.sqrt(rates.var(axis=1, ddof=1).mean() / 2)
    for setting, own in zip(pooled_settings([{}] * 3, found), hits, strict=True):
        engagements = hit_rate(np.sum(own, axis=0), 100)
        assert setting.rate.value == pytest.approx(100 * engagements.rate)
        low = engagements.rate - math.hypot(engagements.rate - engagements.low, half_width)
        assert setting.rate.low == pytest.approx(max(0.0, 100 * low))


def test_a_search_that_ended_at_any_write_goes_on_to_the_same_table(undisturbed, tmp_path, monkeypatch):
    from optuna.storages.journal import JournalFileBackend

    written = JournalFileBackend.append_logs
    for last in range(1, 60, 4):
        out, left = tmp_path / str(last), [last]

        def append(backend, logs, left=left, out=out):
            left[0] -= 1
            if left[0] < 0:
                with (out / "study.jsonl").open("a") as stream:
                    stream.write(json.dumps(logs[0])[:20])  # half a line
                (out / "study.jsonl.lock").symlink_to("study.jsonl")  # the lock of a process that was killed
                raise KeyboardInterrupt
            written(backend, logs)

        monkeypatch.setattr(JournalFileBackend, "append_logs", append)
        with contextlib.suppress(KeyboardInterrupt):
            sweep(**SEARCH, out=out)
        monkeypatch.setattr(JournalFileBackend, "append_logs", written)
        sweep(**SEARCH, out=out)
        assert (out / "results.csv").read_text() == undisturbed
        trained = (out / "trained").read_text().split()
        assert len(set(trained)) == len(trained) == 18
    assert left[0] > 0  # the last one was not ended


def test_a_sweep_that_is_killed_goes_on_to_the_same_table(undisturbed, tmp_path):
    out = tmp_path / "out"
    process = multiprocessing.get_context("spawn").Process(target=sweep_elsewhere, args=(out,))
    process.start()
    while len(list(out.glob(f"trials/*/{HITS}"))) < 8 and process.is_alive():
        time.sleep(0.01)
    process.kill()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    finished = {path.parent.name for path in out.glob(f"trials/*/{HITS}")}
    (out / "trained").unlink()
    sweep(**SEARCH, out=out)
    assert (out / "results.csv").read_text() == undisturbed
    assert not finished & {*(out / "trained").read_text().split()}


def test_what_can_not_be_used_is_refused_in_one_line(refused, at_once, tmp_path):
    def check(pattern, **given):
        refused(pattern, sweep, **{"task": "paper", "out": tmp_path / "none", **given})

    check("'frame'; perhaps you meant frames", vary={"frame": "1,2"})
    check("GradientConfig: .*hidden.*expected `?int`? <= 8192", vary={"gradient.hidden": "16..10000"}, trials=2)
    check("expected LOW..HIGH, with :log above 0, got 0..1:log", vary={"gradient.learning_rate": "0..1:log"}, trials=2)
    check("a range needs trials", vary={"frames": "2..4"})
    check("ppo.clip: the trainer is gradient; leave it out", vary={"ppo.clip": "0.1,0.2"})
    check("trials must be a whole number of 1 to", trials=0)
    sweep(task="paper", vary={"frames": "3,4"}, out=tmp_path / "out")
    other = {"vary": {"frames": "3,4"}, "seeds": 2, "out": tmp_path / "out"}
    check("out: has a sweep with seeds = 1, expected 2; choose another folder", **other)
    check("has files of something else, as out", out=tmp_path)


def test_a_training_that_diverges_is_a_result(tmp_path):
    folder = tmp_path / "0000-0"
    train_and_count(
        af.Robot.paper(),
        af.Task.load("paper"),
        TrainConfig(trainer="ppo", ppo=SMALL),
        2,
        {"ppo.actor_learning_rate": 1e6},
        0,
        folder,
    )
    (failed,) = pooled_settings([{}], [[TrialHits.load(folder / HITS)]])
    assert failed.problem.startswith("training diverged after")
    assert math.isnan(failed.rate.value)


def test_a_training_that_ended_while_it_wrote_a_checkpoint_goes_on_from_the_one_before(tmp_path, monkeypatch):
    config = TrainConfig(trainer="ppo", ppo=SMALL, checkpoint_every_s=0.0)
    given = af.Robot.paper(), af.Task.load("paper"), config, 2, {}, 0
    train_and_count(*given, tmp_path / "whole")
    writes = iter([storage.write_arrays])
    monkeypatch.setattr(storage, "write_arrays", lambda *content: next(writes)(*content))
    with pytest.raises(StopIteration):
        train_and_count(*given, tmp_path / "ended")
    monkeypatch.undo()
    assert [path.name for path in (tmp_path / "ended").glob("checkpoint*")] == ["checkpoint.previous.safetensors"]
    train_and_count(*given, tmp_path / "ended")
    assert (tmp_path / "ended" / HITS).read_text() == (tmp_path / "whole" / HITS).read_text()


def test_on_ray_a_training_whose_worker_was_killed_is_run_again(tmp_path, monkeypatch):
    monkeypatch.setenv("ARCHERFISH_TEST_MARK", str(tmp_path / "mark"))
    monkeypatch.setattr(module, "train_and_count", dies_once)
    settings = ["--set", "trainer=ppo", *(f"ppo.{name}={value}" for name, value in SMALL.items())]
    words = ["--task", "paper", *settings, "--seeds", "2", "--engagements", "2", "--workers", "1", "--ray", "local"]
    main(["sweep", *words, "--out", str(tmp_path / "out")])
    assert (tmp_path / "mark").exists()
    assert sorted(path.parent.name for path in tmp_path.glob(f"out/trials/*/{HITS}")) == ["0000-0", "0000-1"]
    assert len(af.Policy.load(tmp_path / "out" / "best").actor) == 2
    assert (tmp_path / "out" / "report.html").read_text().count("<svg") == 1
