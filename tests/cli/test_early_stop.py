"""What a training is tried on to see whether it has come far enough."""

import numpy as np
import pytest

pytest.importorskip("jax")

from archerfish.cli.early_stop import _together, stopping_suites
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.simulation.assembly import make_environment
from archerfish.targets.drawn import ANY, drawn_motion


@pytest.mark.parametrize("target", [ANY, "pass"])
def test_a_training_is_tried_on_its_own_targets_for_both_lengths(target: str) -> None:
    setting = load_setting(SettingFiles())
    groups = stopping_suites(setting, make_environment(), 0.0, target=target)
    assert [len(each) for each in groups] == [4, 4]
    assert [float(each[0].scenario.lengths[1]) for each in groups] == [1.0, 3.0]
    kinds = {type(suite.scenario.motion) for each in groups for suite in each}
    assert kinds == {type(drawn_motion(target))}


def test_the_paper_s_targets_are_tried_on_as_they_were() -> None:
    setting = load_setting(SettingFiles())
    for share, kinds in ((1.0, {"static"}), (0.0, {"dynamic"}), (0.5, {"static", "dynamic"})):
        (suites,) = stopping_suites(setting, make_environment(), share)
        assert {each.target for each in suites} == kinds


def test_every_decision_of_engagements_of_several_lengths_counts_once() -> None:
    rng = np.random.default_rng(1)
    short, long = rng.random((6, 50)) < 0.8, rng.random((4, 150)) < 0.5
    found = _together([short, long])
    assert (found.hits, found.shots) == (short.sum() + long.sum(), 6 * 50 + 4 * 150)
    assert found.engagements == 10
    assert _together([short]) == hit_rate(short)
