import numpy as np
import pytest

from archerfish.controllers.roster import make_controller
from archerfish.evaluation.bounds.hit_chance import hit_chance, shot_geometry
from archerfish.sensing.interfaces import Engagement
from archerfish.targets.still import Static

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


@pytest.mark.parametrize("range_m", [(1.0, 2.0)])
def test_its_expected_hits_on_still_targets_are_no_fewer_than_a_causal_controller_s(bench, fight, range_m) -> None:
    # Near the line of sight the causal ones lose nothing but the slew: a plan that is not fully converged lost more.
    def expected(name: str) -> float:
        duel = fight(make_controller(name, bench("los-2deg")), "los-2deg", 1.0, batch=100, range_m=range_m)
        muzzle, fired = bench("los-2deg").muzzle, PERIOD * np.arange(1, len(duel.miss) + 1)
        place = duel.truth.motion.position(np.zeros(100, np.float32))
        geometry = shot_geometry(Engagement(Static(place), np.zeros((100, 2)), np.zeros(100)), muzzle, fired)
        offset = np.moveaxis(duel.miss[..., ::-1], 0, 1)
        return float(hit_chance(offset, geometry.sd, HIT_RADIUS).sum())

    oracle = expected("oracle")
    # Both predictors are right about a target that stands still.
    for name in ("kalman-lq", "parabola-lq"):
        assert oracle >= expected(name) - 0.5


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
