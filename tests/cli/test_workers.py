import os
import signal
import time

import pytest

from archerfish.cli.workers import run_tasks
from archerfish.records.errors import InputError


def square(number, advance):
    advance(1.0, "squared")
    return number**2


def fail(number, advance):
    raise InputError(f"can't use {number}")


def wait_long(number, advance):
    time.sleep(600.0)


def die(number, advance):
    os.kill(os.getpid(), signal.SIGKILL)


def environment(name, advance):
    return os.environ.get(name)


def test_results_come_in_the_order_of_the_tasks():
    assert run_tasks("squaring", "numbers", [(square, each, 1.0) for each in (3, 1, 2)], 2) == [9, 1, 4]


def test_a_fault_of_one_task_ends_the_others():
    with pytest.raises(InputError, match="can't use 7"):
        run_tasks("failing", "numbers", [(wait_long, 0, 1.0), (fail, 7, 1.0)], 2)


def test_a_killed_worker_is_told_in_words():
    with pytest.raises(InputError, match="killed, most likely for want of memory"):
        run_tasks("dying", "numbers", [(die, 0, 1.0)], 1)


def test_workers_have_one_thread_each_and_the_parent_keeps_its_own(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    assert run_tasks("asking", "variables", [(environment, "OMP_NUM_THREADS", 1.0)], 1) == ["1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"
