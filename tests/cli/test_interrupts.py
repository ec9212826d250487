"""A signal is never lost: whatever drops the exception, and however long a program does not look."""

import contextlib
import gc
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from archerfish.cli import interrupts
from archerfish.cli.interrupts import Stopped, at_last, stop_requests, without_interrupts
from archerfish.cli.main import main
from archerfish.cli.run_folder import run_folder
from archerfish.cli.writer import Writer

PATIENCE_S = 60.0
BOTH = pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])


def wait() -> None:
    """Compute for ever, as a command does; a signal ends it, a test that fails soon after."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        time.sleep(0.01)
    raise AssertionError("the signal was lost")


class Callback:
    """Stands for a library that calls back where nothing may be raised."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGTERM)
        for _ in range(1000):  # here the exception strikes
            pass


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_signal_whose_exception_a_callback_drops_ends_the_command_all_the_same(monkeypatch):
    monkeypatch.setattr(sys, "unraisablehook", lambda _: None)
    with pytest.raises(Stopped) as ended, stop_requests():
        Callback()
        gc.collect()
        wait()
    assert ended.value.status == 143


@BOTH
def test_an_exception_that_is_caught_and_forgotten_is_raised_again(number, status):
    with pytest.raises(Stopped) as ended, stop_requests():
        with contextlib.suppress(BaseException):
            signal.raise_signal(number)
        wait()
    assert ended.value.status == status


@BOTH
def test_a_command_that_makes_another_error_of_a_signal_ends_with_its_status(monkeypatch, capsys, number, status):
    def answer(words: list[str]) -> None:
        try:
            signal.raise_signal(number)
        except KeyboardInterrupt:
            raise RuntimeError("INTERNAL: callback failed") from None

    monkeypatch.setattr("archerfish.cli.main._answer", answer)
    with pytest.raises(SystemExit) as ended:
        main(["train"])
    assert ended.value.code == status
    assert "what was unfinished is discarded" in capsys.readouterr().err


def test_a_signal_waits_for_a_block_that_must_not_be_interrupted_and_is_not_lost_by_it():
    done = []
    with pytest.raises(Stopped), stop_requests(), without_interrupts():
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.raise_signal(number)
            done.append(number)
    assert done == [signal.SIGINT, signal.SIGTERM]


def test_cleaning_up_is_not_interrupted_and_comes_before_the_end_of_the_process(monkeypatch, tmp_path):
    def answer(words: list[str]) -> None:
        with at_last(lambda: done.append("cleaned up")):
            try:
                signal.raise_signal(signal.SIGTERM)
            finally:
                signal.raise_signal(signal.SIGTERM)
                done.append("not struck again on the way")

    done: list[str] = []
    monkeypatch.setattr("archerfish.cli.main._answer", answer)
    with pytest.raises(SystemExit):
        main(["record"])
    assert done == ["not struck again on the way", "cleaned up"]


def test_a_patient_command_is_asked_once_and_after_a_while_stopped(monkeypatch):
    monkeypatch.setattr(interrupts, "PATIENCE_S", 0.5)
    with pytest.raises(Stopped), stop_requests() as requests:
        requests.patient = True
        signal.raise_signal(signal.SIGTERM)
        assert requests.number == signal.SIGTERM
        wait()


@BOTH
def test_a_run_folder_of_a_stopped_command_is_as_it_was(tmp_path, number, status):
    with pytest.raises(Stopped), stop_requests(), run_folder(tmp_path / "runs" / "x", Writer("record")) as folder:
        (folder / "log.csv").write_text("half")
        signal.raise_signal(number)
    assert list(tmp_path.iterdir()) == []


STUCK = """
import ctypes
from pathlib import Path
from archerfish.cli import interrupts, main
from archerfish.cli.run_folder import run_folder
from archerfish.cli.writer import Writer

def answer(words):
    with run_folder(Path("runs"), Writer("record")):
        while True:  # in a call that goes on after a signal, as a compiled program does
            ctypes.CDLL(None).system(b"echo stuck; exec sleep 3 >/dev/null 2>&1")

interrupts.LONGEST_S = 0.5
main._answer = answer
main.program()
"""

HOLD = """
import sys, time
from pathlib import Path
from archerfish.cli.run_folder import run_folder
from archerfish.cli.writer import Writer

with run_folder(Path("runs"), Writer("record")) as folder:
    (folder / "log.csv").write_text("half")
    print("held", flush=True)
    time.sleep(600)
"""


def names_in(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def begun(code: str, folder: Path) -> subprocess.Popen[str]:
    """Begin a program in a folder, and wait until it says so."""
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout.readline()
    return process


def test_a_program_that_never_looks_is_cleaned_up_after_and_ended(tmp_path):
    with begun(STUCK, tmp_path) as process:
        assert len(list((tmp_path / "runs").iterdir())) == 1
        process.terminate()
        said = process.communicate(timeout=PATIENCE_S)[1]
    assert process.returncode == 143
    assert said == "archerfish: terminated; it did not end by itself within 0.5 s\n"
    assert list(tmp_path.iterdir()) == []


def test_what_a_killed_process_left_vanishes_with_the_next_run_and_what_a_living_one_holds_does_not(tmp_path):
    with begun(HOLD, tmp_path) as living, begun(HOLD, tmp_path) as killed:
        assert len(list((tmp_path / "runs").iterdir())) == 2
        killed.kill()
        killed.wait()
        with run_folder(tmp_path / "runs", Writer("range")):
            (held,) = (each for each in (tmp_path / "runs").iterdir() if (each / "new" / "log.csv").exists())
        assert (held / "new" / "log.csv").read_text() == "half"
        living.kill()
    assert names_in(tmp_path / "runs") == {held.name}
    with run_folder(tmp_path / "runs", Writer("range")) as folder:
        (folder / "shots.csv").write_text("")
    assert names_in(tmp_path / "runs") == {".archerfish.json", "shots.csv"}
