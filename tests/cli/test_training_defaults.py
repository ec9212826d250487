"""What a training takes where the command line does not say."""

from dataclasses import asdict
from pathlib import Path
from typing import get_args

import pytest

from archerfish.cli.options import DrawnTarget, PaperTarget
from archerfish.cli.parsing import parse
from archerfish.cli.restored_options import restore_options
from archerfish.cli.setting import SettingFiles
from archerfish.cli.train import Train
from archerfish.cli.training_defaults import resolved
from archerfish.records.errors import InputError
from archerfish.simulation.scenario import TARGETS
from archerfish.targets.drawn import DRAWN


def settled(words: str = "") -> Train:
    return resolved(parse(Train, "archerfish train", words.split()))


def test_all_targets_that_there_are_can_be_typed() -> None:
    assert get_args(PaperTarget) == tuple(TARGETS)
    assert get_args(DrawnTarget) == DRAWN


@pytest.mark.parametrize("words", ["", "--target any", "--target singer"])
def test_targets_of_any_motion_are_trained_for_by_gradients_with_several_trackers(words: str) -> None:
    command = settled(words)
    assert command.target == (words.split()[-1] if words else "any")
    assert (command.observation, command.trainer) == ("multimodel", "gradient")
    assert (command.gradient.steps, command.gradient.hidden) == (9_000_000, 512)


@pytest.mark.parametrize("target", TARGETS)
def test_the_paper_s_targets_are_trained_for_as_before(target: str) -> None:
    command = settled(f"--target {target}")
    assert (command.target, command.observation, command.trainer) == (target, "history", "ppo")
    assert (command.gradient.steps, command.gradient.hidden) == (500_000, 256)
    sensed = settled(f"--target {target} --sensing sensing.json --robot me")
    assert sensed.observation == "tracked"


def test_what_is_given_stays() -> None:
    command = settled("--observation history --trainer ppo --gradient.steps 500000 --gradient.hidden 256")
    assert (command.target, command.observation, command.trainer) == ("any", "history", "ppo")
    assert (command.gradient.steps, command.gradient.hidden) == (500_000, 256)
    assert settled("--target paper --observation multimodel --trainer gradient").observation == "multimodel"


def test_a_motion_of_one_s_own_goes_with_the_paper_s_targets_alone() -> None:
    command = settled("--motion ./mine.py:Away")
    assert (command.target, command.observation, command.trainer) == ("paper", "history", "ppo")
    assert settled("--motion ./mine.py:Away --target dynamic").target == "dynamic"
    with pytest.raises(InputError, match=r"--motion takes the place of eq \(7\), by which --target any does not move"):
        settled("--motion ./mine.py:Away --target any")


def test_a_run_folder_brings_the_same_settings_back() -> None:
    for words in ("", "--target strafe --gradient.steps 9", "--target static", "--target circle --trainer ppo"):
        command = settled(words)
        plain = {**asdict(command), "setting": {}, "out": "run"}
        begun = restore_options(Train, plain, Path("run/config.json"))
        assert asdict(resolved(begun)) == {**asdict(command), "setting": asdict(SettingFiles()), "out": Path("run")}


@pytest.mark.parametrize("option", ["steps", "hidden"])
def test_a_setting_below_zero_is_refused(option: str) -> None:
    with pytest.raises(InputError, match=f"--gradient.{option} must be at least 1, got -1"):
        parse(Train, "archerfish train", [f"--gradient.{option}", "-1"])
