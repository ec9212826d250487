"""Jobs in processes of their own."""

import multiprocessing
import os
import time

import pytest

from archerfish.errors import InputError
from archerfish.reports.progress import bar
from archerfish.studies.workers import Job, run_jobs


def square(number):
    with bar("squaring", 4, "parts") as advance:
        advance(2)
    return number**2, os.environ["OMP_NUM_THREADS"]


def refuse(number):
    raise InputError(f"{number} is refused; give another", "refused")


def sleep_long():
    time.sleep(60.0)


def end_at_once():
    os._exit(9)


def test_results_come_in_the_order_of_the_jobs(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    jobs = [Job(square, {"number": number}, 4.0 - number) for number in range(3)]
    assert run_jobs("squaring", jobs, 2) == [(0, "1"), (1, "1"), (4, "1")]
    assert os.environ["OMP_NUM_THREADS"] == "3"


def test_an_error_of_a_job_stops_the_others_and_is_raised():
    with pytest.raises(InputError, match=r"^3 is refused; give another$") as error:
        run_jobs("refusing", [Job(sleep_long, {}), Job(refuse, {"number": 3})], 2)
    assert error.value.code == "refused"
    assert multiprocessing.active_children() == []


def test_a_process_that_is_killed_is_said_in_one_line():
    with pytest.raises(InputError, match="a process was killed, most likely for want of memory; use fewer workers"):
        run_jobs("ending", [Job(end_at_once, {})], 1)
