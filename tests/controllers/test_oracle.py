import numpy as np
import pytest

from archerfish.controllers.roster import make_controller

HIT_RADIUS = 0.06
PERIOD = 0.02


@pytest.fixture(scope="module")
def duels(bench, fight):
    """Dispersionless duels of the oracle, by command limit and share of static targets."""
    made = {}

    def duel(limit: str, static_share: float):
        key = limit, static_share
        if key not in made:
            made[key] = fight(make_controller("oracle", bench(limit)), limit, static_share)
        return made[key]

    return duel


def hits(duel) -> np.ndarray:
    """Hits of each engagement."""
    return np.sum(np.linalg.norm(duel.miss, axis=-1) <= HIT_RADIUS, axis=0)


@pytest.mark.parametrize("static_share", [0.0, 1.0])
def test_in_the_box_nearly_every_pellet_hits(duels, static_share) -> None:
    # The first shot, 20 ms after the beginning, is often out of reach.
    assert np.all(hits(duels("box", static_share)) >= 47)


@pytest.mark.parametrize("static_share", [0.0, 1.0])
def test_the_gate_costs_the_slew_alone(duels, static_share) -> None:
    duel = duels("gate", static_share)
    assert np.all(np.linalg.norm(duel.miss[25:], axis=-1) <= HIT_RADIUS)


@pytest.mark.parametrize("limit", ["box", "gate", "los-2deg"])
def test_it_is_nowhere_worse_than_the_strong_baseline(duels, bench, fight, limit) -> None:
    baseline = fight(make_controller("parabola-lq", bench(limit)), limit, static_share=0.0)
    assert np.all(hits(duels(limit, 0.0)) >= hits(baseline) - 1)


@pytest.mark.parametrize("limit", ["box", "gate", "los-2deg"])
def test_the_plan_keeps_the_limits(duels, bench, limit) -> None:
    duel = duels(limit, 0.0)
    limits = bench(limit).limits
    plan = np.concatenate([np.zeros((2, *duel.command.shape[1:])), duel.command])
    rate = np.diff(plan, axis=0) / PERIOD
    acceleration = np.diff(rate, axis=0) / PERIOD
    assert np.all(duel.command >= limits.low - 1e-6)
    assert np.all(duel.command <= limits.high + 1e-6)
    assert np.all(np.abs(rate) <= limits.max_rate * 1.02)
    assert np.all(np.abs(acceleration) <= limits.max_acceleration * 1.1)
    # What the limit then still cuts off is small.
    assert np.max(np.abs(duel.allowed - duel.command)) < 5e-3


def test_without_the_truth_it_refuses(bench, fight) -> None:
    duel = fight(make_controller("no-lead", bench("box")), "box", steps=1)
    seen = type(duel.seen)(*(each[0] for each in duel.seen))
    with pytest.raises(ValueError, match="needs the truth"):
        make_controller("oracle", bench("box")).reset(seen)
