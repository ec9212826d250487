import contextlib
import errno
import json
import os

import pytest

pytest.importorskip("jax")

import archerfish.cli.sweeping.folder as sweep_module
from archerfish.cli.outputs import check_outputs
from archerfish.cli.run_folder import run_folder
from archerfish.cli.sweep import Sweep
from archerfish.cli.sweeping.axes import parse_vary
from archerfish.cli.sweeping.executor import in_process
from archerfish.cli.sweeping.folder import RESULTS, sweep_folder
from archerfish.cli.sweeping.proposals import proposed_grid
from archerfish.cli.sweeping.results import read_results, results_table
from archerfish.cli.sweeping.run import planned_trials, run_rounds
from archerfish.cli.writer import Writer
from archerfish.records.errors import InputError

from .made_trials import backwards, ending_after, made_up_hits

TOLD = {"vary": ["ppo.clip=0.1,0.2"]}
AXES = parse_vary(["ppo.clip=0.1,0.2"])


def sweep(out, plan, executor, resume=False, axes=AXES, told=TOLD):
    with sweep_folder(out, told, resume) as folder:
        run_rounds(plan, proposed_grid(axes), folder, executor, work=made_up_hits)
        return results_table(folder.results.values())


def test_trials_are_numbered_by_configuration_world_and_seed(make_plan):
    plan = make_plan((7, 8), ({"command-limit": "box"}, {"command-limit": "gate"}))
    found = planned_trials(plan, 3, [{"ppo.clip": 0.1}])
    assert [(each.trial, each.configuration, each.values["command-limit"], each.seed) for each in found] == [
        (12, 3, "box", 7),
        (13, 3, "box", 8),
        (14, 3, "gate", 7),
        (15, 3, "gate", 8),
    ]


def test_the_table_does_not_depend_on_who_finishes_first(make_plan, tmp_path):
    plan = make_plan()
    assert sweep(tmp_path / "a", plan, in_process) == sweep(tmp_path / "b", plan, backwards)


def test_a_trial_leaves_its_files_and_a_line(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    assert sorted(path.name for path in (tmp_path / "trials").iterdir()) == ["0000", "0001", "0002", "0003"]
    assert (tmp_path / "trials" / "0002" / "log.jsonl").read_text() == "0.2 0\n"
    lines = [json.loads(line) for line in (tmp_path / RESULTS).read_text().splitlines()]
    assert [(line["trial"], line["parameters"], line["seed"]) for line in lines] == [
        (0, {"ppo.clip": 0.1}, 0),
        (1, {"ppo.clip": 0.1}, 1),
        (2, {"ppo.clip": 0.2}, 0),
        (3, {"ppo.clip": 0.2}, 1),
    ]


@pytest.mark.parametrize("torn", [b"", b'{"trial": 0, "conf'], ids=["between trials", "within a line"])
def test_a_killed_sweep_goes_on_and_does_no_trial_twice(make_plan, tmp_path, torn):
    plan = make_plan()
    with pytest.raises(KeyboardInterrupt):
        sweep(tmp_path / "a", plan, ending_after(2))
    with (tmp_path / "a" / RESULTS).open("ab") as stream:
        stream.write(torn)
    (tmp_path / "a" / "trials" / "0000").mkdir()  # files of a trial whose line was never written
    begun = []

    def watched(work, jobs):
        begun.extend((job.task.ppo.clip, job.task.seed) for job in jobs)
        yield from in_process(work, jobs)

    table = sweep(tmp_path / "a", plan, watched, resume=True)
    assert begun == [(0.1, 0), (0.1, 1)]
    assert table == sweep(tmp_path / "b", plan, in_process)
    assert sorted(each.trial for each in read_results(tmp_path / "a" / RESULTS)) == [0, 1, 2, 3]


def test_a_finished_sweep_that_is_resumed_runs_nothing(make_plan, tmp_path):
    plan = make_plan()
    table = sweep(tmp_path, plan, in_process)
    assert sweep(tmp_path, plan, lambda work, jobs: iter(()), resume=True) == table


def test_a_training_that_diverges_is_recorded_and_not_tried_again(make_plan, tmp_path):
    axes = parse_vary(["ppo.clip=0.2,0.6"])
    sweep(tmp_path, make_plan((0,)), in_process, axes=axes)
    results = read_results(tmp_path / RESULTS)
    assert [each.problem for each in results] == [None, "training diverged after 0 decisions"]
    assert (results[1].hits, results[1].shots, results[1].rate) == (0, 0, 0.0)
    assert not (tmp_path / "trials" / "0001").exists()
    sweep(tmp_path, make_plan((0,)), lambda work, jobs: iter(()), resume=True, axes=axes)


def test_a_combination_that_cant_be_trained_is_a_failed_trial(make_plan, tmp_path):
    with sweep_folder(tmp_path, TOLD, False) as folder:
        proposer = iter_of([{"ppo.minibatches": 7}, {"ppo.minibatches": 8}])
        run_rounds(make_plan((0,)), proposer, folder, in_process, work=made_up_hits)
        assert "must divide into minibatches × shards = 7 × 2" in folder.results[0].problem
        assert folder.results[1].problem is None


def iter_of(configurations):
    yield configurations


def test_a_folder_that_holds_a_sweep_is_refused_without_resume(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    with pytest.raises(InputError, match="holds a sweep with 4 finished trials; add --resume"):
        sweep(tmp_path, make_plan(), in_process)


def test_another_sweep_is_not_taken_up(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    with pytest.raises(InputError, match=r"was begun with vary \['ppo.clip=0.1,0.2'\], not \['ppo.clip=0.3'\]"):
        sweep(tmp_path, make_plan(), in_process, resume=True, told={"vary": ["ppo.clip=0.3"]})
    with pytest.raises(InputError, match=r"trial 2 was done with parameters .*0\.2.*now it would be .*0\.3"):
        sweep(tmp_path, make_plan(), in_process, resume=True, axes=parse_vary(["ppo.clip=0.1,0.3"]))


def test_two_processes_are_not_at_one_sweep(make_plan, tmp_path):
    pytest.importorskip("fcntl")
    with sweep_folder(tmp_path, TOLD, False), pytest.raises(InputError, match="is writing this run; wait for it"):
        sweep(tmp_path, make_plan(), in_process)
    assert list(tmp_path.iterdir()) == []


def test_a_sweep_that_another_process_finished_just_before_the_lock_is_refused(make_plan, tmp_path, monkeypatch):
    lock = sweep_module.locked

    @contextlib.contextmanager
    def late(out):
        monkeypatch.setattr(sweep_module, "locked", lock)
        sweep(out, make_plan(), in_process)
        with lock(out):
            yield

    monkeypatch.setattr(sweep_module, "locked", late)
    with pytest.raises(InputError, match="holds a sweep with 4 finished trials; add --resume"):
        sweep(tmp_path, make_plan(), in_process)
    assert [each.trial for each in read_results(tmp_path / RESULTS)] == [0, 1, 2, 3]


@pytest.mark.parametrize("before", [0, 2], ids=["the first line", "a later line"])
def test_a_full_disk_ends_a_sweep_at_a_whole_line(make_plan, tmp_path, monkeypatch, before):
    plan, write, lines = make_plan(), os.write, []

    def full(stream, content):
        if not lines and not content.startswith(b'{"trial"'):
            return write(stream, content)
        lines.append(content)
        if len(lines) > before + 1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        # Of the last line a part, as the system does it.
        return write(stream, content if len(lines) <= before else content[:20])

    with monkeypatch.context() as patched:
        patched.setattr(os, "write", full)
        told = r"results.jsonl: can't be written \(No space left on device\); free the disk, then go on with --resume"
        with pytest.raises(InputError, match=told):
            sweep(tmp_path / "full", plan, in_process)
    assert len(read_results(tmp_path / "full" / RESULTS)) == before
    if before:
        assert (tmp_path / "full" / RESULTS).read_bytes() == b"".join(lines[:before])
    else:
        assert not (tmp_path / "full").exists()
    table = sweep(tmp_path / "full", plan, in_process, resume=True)
    assert table == sweep(tmp_path / "roomy", plan, in_process)


def test_a_trial_is_never_recorded_twice(make_plan, tmp_path):
    def twice(work, jobs):
        for index, job in enumerate(jobs):
            yield index, work(job)
            yield index, work(job)

    with pytest.raises(InputError, match="trial 0 is done already"):
        sweep(tmp_path, make_plan(), twice)
    assert [each.trial for each in read_results(tmp_path / RESULTS)] == [0]


def test_a_damaged_line_is_named(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    path = tmp_path / RESULTS
    path.write_text(path.read_text().replace('"hits"', '"hurts"', 1))
    with pytest.raises(InputError, match="line 1 is not a trial"):
        read_results(path)
    whole = path.read_text().splitlines()
    path.write_text("\n".join([whole[1], whole[1], ""]))
    with pytest.raises(InputError, match="line 2: trial 1 is there twice"):
        read_results(path)


def test_a_sweep_that_ends_before_its_first_trial_leaves_nothing(make_plan, tmp_path):
    with pytest.raises(KeyboardInterrupt):
        sweep(tmp_path / "deep" / "out", make_plan(), ending_after(0))
    assert list(tmp_path.iterdir()) == []


FOREIGN = ["mine", '{"a": 1}', '{"trial": 0, "conf', "\n"]


@pytest.mark.parametrize("content", FOREIGN)
@pytest.mark.parametrize("resume", [False, True])
def test_results_that_no_sweep_wrote_stay(make_plan, tmp_path, content, resume):
    (tmp_path / RESULTS).write_text(content)
    with pytest.raises(InputError, match=r"results\.jsonl: .*(no sweep wrote it|none that a sweep wrote|not a trial)"):
        sweep(tmp_path, make_plan(), in_process, resume=resume)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(RESULTS, content)]


@pytest.mark.parametrize("kind", ["pipe", "link", "dangling link"])
def test_results_are_no_link_and_no_pipe(make_plan, tmp_path, kind):
    out, other = tmp_path / "out", tmp_path / "other.txt"
    out.mkdir()
    if kind == "pipe":
        os.mkfifo(out / RESULTS)
    else:
        (out / RESULTS).symlink_to(other)
    if kind == "link":
        other.write_text("mine")
    with pytest.raises(InputError, match=r"results\.jsonl: can't be written, since it is a (named pipe|symbolic link)"):
        sweep(out, make_plan(), in_process)
    assert [path.name for path in out.iterdir()] == [RESULTS]
    assert other.exists() == (kind == "link")


def test_what_follows_the_last_line_of_a_sweep_is_lost_only_if_it_is_part_of_a_line(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    with (tmp_path / RESULTS).open("a") as stream:
        stream.write("a note")
    with pytest.raises(InputError, match="its last line is none that a sweep wrote"):
        sweep(tmp_path, make_plan(), in_process, resume=True)
    assert (tmp_path / RESULTS).read_text().endswith("\na note")


def test_finished_trials_without_their_line_are_not_trained_again_unless_that_is_said(make_plan, tmp_path):
    table = sweep(tmp_path, make_plan(), in_process)
    (tmp_path / RESULTS).unlink()
    own = tmp_path / "trials" / "0001" / "notes.txt"
    own.write_text("mine")
    for resume in (False, True):
        with pytest.raises(InputError, match=r"trials/0000: holds files, and results\.jsonl has no line of that trial"):
            sweep(tmp_path, make_plan(), in_process, resume=resume)
    assert (tmp_path / "trials" / "0003" / "policy.json").exists()
    with sweep_folder(tmp_path, TOLD, True, Writer("sweep", overwrite=True)) as folder:
        run_rounds(make_plan(), proposed_grid(AXES), folder, in_process, work=made_up_hits)
        assert results_table(folder.results.values()) == table
    assert own.read_text() == "mine"


def test_files_of_a_trial_that_is_done_are_put_in_place_after_a_kill(make_plan, tmp_path, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(sweep_module, "_put_in_place", killed)
        with pytest.raises(KeyboardInterrupt):
            sweep(tmp_path, make_plan(), in_process)
    assert [path.name for path in (tmp_path / "trials").iterdir()] == [".unfinished-0000"]
    sweep(tmp_path, make_plan(), in_process, resume=True)
    assert sorted(path.name for path in (tmp_path / "trials").iterdir()) == ["0000", "0001", "0002", "0003"]
    assert (tmp_path / "trials" / "0000" / "log.jsonl").read_text() == "0.1 0\n"


def test_a_resumed_sweep_leaves_what_lies_in_the_folders_of_finished_trials(make_plan, tmp_path):
    sweep(tmp_path, make_plan(), in_process)
    evaluated = tmp_path / "trials" / "0000" / "ev" / "results.json"
    with run_folder(evaluated.parent, Writer("evaluate")) as folder:
        (folder / "results.json").write_text("{}")
    check_outputs(Sweep(out=tmp_path, resume=True))
    sweep(tmp_path, make_plan(), in_process, resume=True)
    assert evaluated.exists()


def test_folders_of_others_are_left_alone(make_plan, tmp_path):
    (tmp_path / "trials").mkdir()
    (tmp_path / "trials" / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match="no sweep made it"):
        sweep(tmp_path, make_plan(), in_process)
    assert (tmp_path / "trials" / "mine.txt").read_text() == "mine"
