"""Detections made by hand."""

import pytest

from archerfish2.protocols import Barrel, Base, Frames, GimbalFeedback, Seen


@pytest.fixture(scope="session")
def seen():
    """Make what is seen of a plate, B + (3,), by a resting gimbal whose base is at a place and moves at a velocity."""

    def make(place, elapsed=0.02, age=0.04, own=(0.0, 0.0)):
        zero, pair, here = 0.0 * place[..., 0], 0.0 * place[..., :2], place[..., :1] == place[..., :1]
        frames = Frames(here, zero[..., None] + age, here[..., None], place[..., None, None, :], zero[..., None, None])
        base, barrel = Base(*(0.0 * place + each for each in own), zero, zero), Barrel(zero, zero)
        return Seen(zero + elapsed, GimbalFeedback(pair, pair, zero), pair, frames, base, barrel)

    return make


@pytest.fixture(scope="session")
def follow(seen):
    """Return a predictor's estimate against the own pivot after places, (T,) + B + (3,), seen alike."""

    def run(predictor, places, **facts):
        state = predictor.step(predictor.reset(seen(places[0], **facts)), seen(places[0], elapsed=0.0, **facts))
        for place in places[1:]:
            state = predictor.step(state, seen(place, **facts))
        return predictor.against_pivot(state, seen(places[-1], **facts).base)

    return run
