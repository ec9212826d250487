from dataclasses import replace

import numpy as np
import pytest

from archerfish.records.errors import InputError
from archerfish.viewer.choice import Choice, Subject
from archerfish.viewer.hand import FARTHEST, HandRun, follow
from archerfish.viewer.motions import HAND
from archerfish.viewer.trial import moment

PLACE = np.array([3.0, 0.0, 0.0])


@pytest.fixture
def dragged(choice: Choice) -> Choice:
    return replace(choice, motion=HAND, speed=1.0)


def test_the_target_goes_to_the_hand_at_a_bounded_speed() -> None:
    place, velocity, fastest = PLACE, np.zeros(3), 0.0
    for _ in range(200):
        place, velocity = follow(place, velocity, np.array([3.0, 1.0, 0.2]), 0.8, 0.02)
        fastest = max(fastest, float(np.linalg.norm(velocity)))
    assert fastest <= 0.8
    np.testing.assert_allclose(place, [3.0, 1.0, 0.2], atol=1e-3)


def test_the_target_stays_within_the_field() -> None:
    place, velocity = PLACE, np.zeros(3)
    for _ in range(400):
        place, velocity = follow(place, velocity, np.array([100.0, 0.0, 0.0]), 3.0, 0.02)
    assert place[0] <= FARTHEST + 0.05


def test_a_resting_hand_is_a_still_target(subject: Subject, dragged: Choice) -> None:
    run = HandRun(subject, replace(dragged, dispersion=0.0), PLACE)
    for _ in range(80):
        run.step(PLACE)
    trial = run.trial()
    landed = np.isfinite(trial.flight_time[0])
    assert landed.sum() > 60
    assert trial.hit[0, 30:][landed[30:]].all()
    assert not trial.hit[0][~landed].any()


def test_dragging_moves_target_gimbal_and_misses(subject: Subject, dragged: Choice) -> None:
    still, moved = (HandRun(subject, dragged, PLACE) for _ in range(2))
    for _ in range(60):
        still.step(PLACE)
        moved.step(np.array([3.0, 1.0, 0.0]))
    assert moved.trial().place[0, -1, 1] > 0.5
    assert moved.trial().angle[0, -1, 1] > still.trial().angle[0, -1, 1] + 0.1
    assert not np.array_equal(still.trial().miss, moved.trial().miss)


def test_pellets_are_judged_when_they_land(subject: Subject, dragged: Choice) -> None:
    run = HandRun(subject, dragged, PLACE)
    run.step(PLACE)
    shown = moment(run.trial(), 0, run.elapsed)
    assert len(shown.pellets) == 1
    assert len(shown.misses) == 0
    for _ in range(20):
        run.step(PLACE)
    trial = run.trial()
    shown = moment(trial, 0, run.elapsed)
    assert len(shown.misses) == np.isfinite(trial.flight_time).sum() > 0
    assert len(shown.misses) + len(shown.pellets) == 21


def test_latency_and_any_controller_but_the_oracle_play_along(subject: Subject, dragged: Choice) -> None:
    run = HandRun(subject, replace(dragged, controller="parabola-lq", camera_latency=0.02), PLACE)
    for _ in range(5):
        run.step(PLACE)
    assert np.isfinite(run.trial().angle).all()
    with pytest.raises(InputError, match="beforehand"):
        HandRun(subject, replace(dragged, controller="oracle"), PLACE)
