"""The stored settings for the printed gimbal: complete, at no edge, and those of this code."""

import pytest

from archerfish.cli.evaluation_run import EvaluationTask, is_stored, tuned_rate, tuning_ground, untuned, with_tuning
from archerfish.cli.setting import SettingFiles, load_setting
from archerfish.controllers.roster import Tuning
from archerfish.evaluation.tuning import BUDGET, GRIDS, LEAST_GAIN
from archerfish.paper.tuning import paper_tunings

LIMITS = ("gate", "box", "los-2deg")
TUNED = {each: stored for stored in paper_tunings() for each in [(stored.command_limit, stored.controller)]}
PROBE_ENGAGEMENTS = 4


def test_every_controller_but_the_calibrated_one_has_settings_under_every_limit() -> None:
    assert set(TUNED) == {(limit, name) for limit in LIMITS for name in GRIDS if name != "kalman"}


@pytest.mark.parametrize("key", TUNED)
def test_no_setting_lies_at_an_edge_of_what_was_tried(key) -> None:
    stored = TUNED[key]
    assert stored.tried <= BUDGET
    assert set(stored.neighbours) == set(GRIDS[stored.controller])
    for name, sides in stored.neighbours.items():
        value = stored.settings[name]
        for side, sign in (("below", -1), ("above", 1)):
            beside = sides[side]
            if beside is None:  # a natural bound
                assert (name, side, value) == ("velocity_decay", "above", 1.0)
            else:
                assert sign * (beside["value"] - value) > 0.0
                assert beside["hit_rate"] < stored.hit_rate + LEAST_GAIN


# The plain filter under every limit costs one compilation, the strongest controller that knows no rule another.
@pytest.mark.parametrize("key", [*((limit, "kalman-tuned") for limit in LIMITS), ("gate", "imm-lq")])
def test_stored_settings_hit_as_often_as_when_they_were_found(key) -> None:
    limit, name = key
    task = EvaluationTask(load_setting(SettingFiles()), limit, 2, 0)
    rate = tuned_rate(task, tuning_ground(task, PROBE_ENGAGEMENTS), name, Tuning(**TUNED[key].settings))
    # 1600 shots; another processor may round a few of them to the other side.
    assert rate == pytest.approx(TUNED[key].probe_hit_rate, abs=0.004)


def test_with_the_printed_gimbal_settings_are_stored_and_the_calibrated_filter_keeps_its_own() -> None:
    setting = load_setting(SettingFiles())
    task = EvaluationTask(setting, "box", 2, 0, ("perfect", "kalman", "kalman-lq", "imm-lq", "oracle"))
    assert untuned(task) == ("kalman-lq", "imm-lq")
    assert is_stored(task)
    found = with_tuning(task).tuning
    assert found == {name: Tuning(**TUNED["box", name].settings) for name in ("kalman-lq", "imm-lq")}
