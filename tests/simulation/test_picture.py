import numpy as np

from archerfish.simulation.picture import FIELD_WIDTH, GIMBAL, HEIGHT, HIT, MISS, NEAR_WIDTH, View, draw


def view(pitch: float = 0.0, yaw: float = 0.0, misses: tuple = ()) -> View:
    plate = np.array([3.0, 0.0, 0.0], np.float32)
    angle = np.array([pitch, yaw], np.float32)
    return View(angle, np.zeros(2, np.float32), plate, np.array(misses, np.float32).reshape(-1, 2), 0.06)


def middle(picture: np.ndarray, colour: tuple) -> tuple[float, float]:
    """Mean row and column of the pixels whose colour has the proportions of `colour`."""
    shares = picture / np.maximum(picture.sum(axis=-1, keepdims=True), 1)
    rows, columns = np.nonzero(np.abs(shares - np.array(colour) / sum(colour)).max(axis=-1) < 0.02)
    return float(rows.mean()), float(columns.mean())


def test_the_cross_is_left_for_positive_yaw_and_high_for_a_muzzle_up() -> None:
    picture = draw(view(pitch=0.2, yaw=0.4))[:, :FIELD_WIDTH]
    rows, columns = np.nonzero((picture == GIMBAL).all(axis=-1))
    assert rows.mean() < HEIGHT / 2 - 20
    assert columns.mean() < FIELD_WIDTH / 2 - 20


def test_hits_and_misses_are_where_they_passed() -> None:
    picture = draw(view(misses=((0.03, 0.03), (-0.1, -0.1))))[:, FIELD_WIDTH:]
    row, column = middle(picture, HIT)
    assert row < HEIGHT / 2
    assert column < NEAR_WIDTH / 2
    row, column = middle(picture, MISS)
    assert row > HEIGHT / 2
    assert column > NEAR_WIDTH / 2


def test_what_is_outside_the_picture_does_no_harm() -> None:
    picture = draw(view(pitch=3.0, yaw=-3.0, misses=((50.0, -50.0),)))
    assert picture.shape == (HEIGHT, FIELD_WIDTH + NEAR_WIDTH, 3)
