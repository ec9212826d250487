import numpy as np

from archerfish.virtual_robot.mailbox import Mailbox, arrivals


def test_messages_queue_behind_a_late_one() -> None:
    sent, latency = np.array([[0.0, 1.0, 2.0, 3.0]]), np.array([[5.0, 1.0, 1.0, 4.0]])
    received, last = arrivals(sent, latency, np.zeros((1, 4), bool), np.array([-np.inf]))
    np.testing.assert_array_equal(received, [[5.0, 5.0, 5.0, 7.0]])
    np.testing.assert_array_equal(last, [7.0])
    following, _ = arrivals(np.array([[4.0]]), np.array([[0.5]]), np.zeros((1, 1), bool), last)
    np.testing.assert_array_equal(following, [[7.0]])


def test_a_lost_message_neither_arrives_nor_holds_up() -> None:
    sent, latency = np.array([[0.0, 1.0]]), np.array([[50.0, 1.0]])
    received, last = arrivals(sent, latency, np.array([[True, False]]), np.array([-np.inf]))
    np.testing.assert_array_equal(received, [[np.inf, 2.0]])
    np.testing.assert_array_equal(last, [2.0])


def test_a_random_channel_never_reorders() -> None:
    rng = np.random.default_rng(0)
    sent = np.cumsum(rng.uniform(0.0, 0.01, (20, 500)), axis=1)
    received, _ = arrivals(sent, rng.uniform(0.0, 0.1, sent.shape), rng.random(sent.shape) < 0.1, np.full(20, -np.inf))
    assert np.all(received >= sent)
    for row in received:
        assert np.all(np.diff(row[np.isfinite(row)]) >= 0.0)


def test_what_has_arrived_is_taken_once_and_in_order() -> None:
    box = Mailbox(2, 1)
    box.put(np.array([[1.0, 2.0, 4.0], [3.0, np.inf, 5.0]]), np.arange(6.0).reshape(2, 3, 1))
    received, content = box.take(2.5)
    np.testing.assert_array_equal(received, [[1.0, 2.0], [np.nan, np.nan]])
    np.testing.assert_array_equal(content[0, :, 0], [0.0, 1.0])
    box.put(np.array([[4.5], [4.5]]), np.array([[[6.0]], [[7.0]]]))
    received, content = box.take(4.5)
    np.testing.assert_array_equal(received, [[4.0, 4.5], [3.0, 4.5]])
    np.testing.assert_array_equal(content[..., 0], [[2.0, 6.0], [3.0, 7.0]])
    received, content = box.take(10.0)
    np.testing.assert_array_equal(received, [[np.nan], [5.0]])
    assert box.take(np.inf)[0].shape == (2, 0)


def test_a_fixed_number_of_places_is_filled_up_and_never_overrun() -> None:
    box = Mailbox(1, 1)
    box.put(np.array([[1.0, 2.0, 3.0]]), np.zeros((1, 3, 1)))
    assert box.take(0.5, 2)[0].shape == (1, 2)
    np.testing.assert_array_equal(box.take(5.0, 2)[0], [[1.0, 2.0]])
    np.testing.assert_array_equal(box.take(5.0, 4)[0], [[3.0, np.nan, np.nan, np.nan]])
