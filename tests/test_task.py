"""Tasks and their files."""

import json

import pytest

from archerfish.records.json_files import plain
from archerfish.task import DRAWN, Task

FAULTS = {
    "period_s = 0": "field period_s: expected float >= 0.0001, got 0",
    "ranges_m = [[2, 1]]": "ranges_m and lengths_s: expected the smaller one first",
    "lenghts_s = [1]": "there is no field lenghts_s; perhaps you meant lengths_s",
    'motion = "strfe"': "field motion: expected one of paper, static,",
    'motion = "./mine.py:Mine"': "code that only a file names is not run",
    "ranges_m = " + 9999 * "[": "recursion",
}

RANGES = ({}, {"ranges_m": ((2, 3),)}, {"ranges_m": ((2, 4), (2, 3))})


def test_a_file_keeps_a_task(tmp_path):
    task = Task.load("strafe").replace(name='Läufer "1"', ranges_m=[[2, 3.5]], lengths_s=(0.5,), start=(0.1, -0.2))
    task.save(tmp_path / "task.toml")
    assert Task.load(tmp_path / "task.toml") == task


def test_what_a_motion_gives_a_task_changes_with_it_and_a_range_keeps_its_engagements(refused):
    assert Task().replace(motion="paper") == Task.load("paper")
    assert Task.load("paper").replace(motion="any", lengths_s=(1.0,)) == Task(lengths_s=(1.0,))
    given = Task(motion="paper", lengths_s=(1.0,))  # as it happens, the paper's
    assert given.replace(motion="any") == Task(lengths_s=(1.0,))
    assert (Task().lengths, Task.load("paper").lengths, Task(lengths_s=(2.0,)).lengths) == ((1.0, 3.0), (1.0,), (2.0,))
    refused("Task: there is no field width; fields are name, motion", Task().replace, width=2)
    whole, near, own = (Task(motion="static", **each).cells() for each in RANGES)
    assert [each.stream for each in (whole[1], near[0], *own)] == [1, 1, 1004, 1]


@pytest.mark.parametrize("text", FAULTS)
def test_what_a_file_has_wrong_is_named(tmp_path, text, refused):
    (tmp_path / "task.toml").write_text(text)
    refused(f"^{tmp_path / 'task.toml'}: .*{FAULTS[text]}", Task.load, tmp_path / "task.toml")


def test_any_mutated_file_is_a_task_or_refused(tmp_path, mutated):
    path = tmp_path / "mine.toml"
    path.write_text(json.dumps(plain(Task.load("paper"))))
    for task in mutated(path, lambda: Task.load(path), 60):
        task.save(path)
        assert Task.load(path) == task


def test_mixtures_are_trained_on_and_evaluated_kind_by_kind():
    found, other = ([each[:6] for each in Task.load(name).cells()] for name in ("any", "kinds"))
    assert found == other
    assert [each[1] for each in found[::4]] == 2 * list(DRAWN[2:])
