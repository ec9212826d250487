from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from archerfish.records.errors import InputError
from archerfish.records.message_times import FEWEST, LONGEST_S, read_message_times_csv


def written(folder: Path, sent: np.ndarray, received: np.ndarray, header: str = "sent_s,received_s") -> Path:
    path = folder / "commands.csv"
    np.savetxt(path, np.column_stack([sent, received]), "%.9f", ",", header=header, comments="")
    return path


def messages(count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    sent = 100.0 + 0.005 * np.arange(count)
    return sent, sent + np.random.default_rng(0).uniform(0.005, 0.015, count)


def test_both_stamps_and_their_difference_are_read(tmp_path: Path) -> None:
    sent, received = messages()
    times = read_message_times_csv(written(tmp_path, sent, received))
    assert_allclose(times.sent, sent, atol=1e-9)
    assert_allclose(times.received, received, atol=1e-9)
    assert_allclose(times.latency, received - sent, atol=1e-8)


def test_other_columns_and_any_order_of_them_do_not_matter(tmp_path: Path) -> None:
    sent, received = messages()
    path = tmp_path / "commands.csv"
    np.savetxt(
        path, np.column_stack([received, 0 * sent, sent]), "%.9f", ",", header="received_s,kind,sent_s", comments=""
    )
    assert_allclose(read_message_times_csv(path).sent, sent, atol=1e-9)


def test_messages_may_arrive_at_once_and_together(tmp_path: Path) -> None:
    sent, _ = messages()
    received = np.repeat(sent[1::2], 2) + 0.0  # two by two, the second without any delay
    assert read_message_times_csv(written(tmp_path, sent, received)).latency.min() == pytest.approx(0.0, abs=1e-8)


def test_the_fewest_messages_are_enough_and_fewer_are_not(tmp_path: Path) -> None:
    assert len(read_message_times_csv(written(tmp_path, *messages(FEWEST))).sent) == FEWEST
    with pytest.raises(InputError, match=rf"commands\.csv: {FEWEST - 1} messages, expected at least {FEWEST}"):
        read_message_times_csv(written(tmp_path, *messages(FEWEST - 1)))


@pytest.mark.parametrize("late", [-0.001, LONGEST_S + 0.1])
def test_stamps_of_two_clocks_are_refused_with_their_line(tmp_path: Path, late: float) -> None:
    sent, received = messages()
    received[20] = sent[20] + late
    with pytest.raises(InputError, match=rf"line 22: received {late:.4g} s after it was sent.*one clock"):
        read_message_times_csv(written(tmp_path, sent, received))


@pytest.mark.parametrize("step", [0.0, -0.003])
def test_times_that_do_not_increase_are_refused_with_their_line(tmp_path: Path, step: float) -> None:
    sent, received = messages()
    sent[20] = sent[19] + step
    with pytest.raises(InputError, match="line 22: sent_s does not increase"):
        read_message_times_csv(written(tmp_path, sent, received))


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match='no column "received_s"'):
        read_message_times_csv(written(tmp_path, *messages(), header="sent_s,got_s"))
