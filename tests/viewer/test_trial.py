from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from archerfish.cli.setting import SettingFiles, load_setting, setting_world
from archerfish.controllers.roster import find_controller
from archerfish.evaluation.hit_rate import hit_rate
from archerfish.records.errors import InputError
from archerfish.targets.own_motion import find_motion
from archerfish.viewer.choice import RANGES, Choice, Subject, check_choice, chosen_controller, controller_names
from archerfish.viewer.hand import HandRun
from archerfish.viewer.motions import DRAWN_MOTIONS, HAND, MOTIONS, meet
from archerfish.viewer.score import compared, count_words, difference_words, rate_words, score
from archerfish.viewer.trial import moment, run_trial

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize("controller", ["kalman", "kalman-lq", "oracle"])
def test_a_trial_is_what_evaluation_would_see(subject: Subject, choice: Choice, controller: str) -> None:
    pytest.importorskip("jax")
    from archerfish.evaluation.suites import Trials
    from archerfish.evaluation.trial import fight

    chosen = replace(choice, controller=controller)
    world = setting_world(load_setting(SettingFiles()), "gate")
    conditions = subject.conditions
    draws = np.random.default_rng([chosen.seed, 72]).standard_normal((4, 50, world.normals)).astype(np.float32)
    engagements = meet(chosen.motion, chosen.distance, chosen.speed, conditions, 4, 1, chosen.seed)
    expected = fight(world, chosen_controller(subject, chosen), Trials((), engagements, draws))
    trial = run_trial(subject, chosen)
    np.testing.assert_allclose(trial.miss, expected.miss, atol=2e-4)
    np.testing.assert_allclose(trial.angle[:, 1:], expected.angle, atol=1e-4)


def test_equal_choices_give_equal_trials(subject: Subject, choice: Choice) -> None:
    first, second = run_trial(subject, choice), run_trial(subject, choice)
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


@pytest.mark.parametrize(
    "changes",
    [
        {"controller": "kalman-lq"},
        {"motion": "circle"},
        {"distance": 4.0},
        {"speed": 1.0},
        {"dispersion": 2.0},
        {"camera_latency": 0.03},
        {"command_latency": 0.03},
        {"seed": 1},
    ],
    ids=lambda changes: next(iter(changes)),
)
def test_everything_that_is_chosen_changes_the_trial(subject: Subject, choice: Choice, changes: dict) -> None:
    assert not np.array_equal(run_trial(subject, choice).miss, run_trial(subject, replace(choice, **changes)).miss)


def test_another_controller_meets_the_same_targets_with_the_same_dispersion(subject: Subject, choice: Choice) -> None:
    still = replace(choice, dispersion=0.0)
    ours, theirs = run_trial(subject, choice), run_trial(subject, replace(choice, controller="kalman-lq"))
    assert np.array_equal(ours.place, theirs.place)
    # Of both, what the dispersion adds to the shots is the same: the pellets leave off the barrel by the same angles.
    exact = run_trial(subject, still), run_trial(subject, replace(still, controller="kalman-lq"))
    speeds = [np.linalg.norm(trial.velocity, axis=-1) for trial in (ours, theirs, *exact)]
    assert all(np.allclose(speeds[0], each, atol=1e-4) for each in speeds[1:])
    assert compared(ours, theirs).low <= compared(ours, theirs).difference


def test_latency_costs_hits_of_a_moving_target(subject: Subject, choice: Choice) -> None:
    crossing = replace(choice, motion="straight across", speed=1.0, engagements=12)
    late = replace(crossing, command_latency=0.08)
    assert run_trial(subject, late).hit.sum() < run_trial(subject, crossing).hit.sum()


def test_without_dispersion_the_still_target_is_hit_by_every_settled_shot(subject: Subject, choice: Choice) -> None:
    trial = run_trial(subject, replace(choice, motion="still", dispersion=0.0))
    assert trial.hit[:, 25:].all()
    assert np.abs(trial.error[:, 40:]).max() < 3e-3


@pytest.mark.parametrize("motion", DRAWN_MOTIONS)
def test_drawn_motions_keep_to_their_own_speeds_in_front_of_the_robot(subject: Subject, motion: str) -> None:
    slow, fast = (meet(motion, 3.0, speed, subject.conditions, 8, 1, 0) for speed in (0.0, 3.0))
    times = np.arange(0.0, 1.0, 0.01, dtype=np.float32)
    way, same = (np.stack([each.motion.position(np.full(8, time)) for time in times]) for each in (slow, fast))
    np.testing.assert_array_equal(way, same)
    assert np.all(way[..., 0] > 0.59 * 3.0)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=-1) / 0.01
    assert 0.1 < speed.max() <= 3.01


@pytest.mark.parametrize("motion", [name for name in MOTIONS if name not in DRAWN_MOTIONS])
def test_targets_keep_their_distance_and_speed(subject: Subject, motion: str) -> None:
    engagements = meet(motion, 3.0, 0.8, subject.conditions, 8, 1, 0)
    times = np.arange(0.0, 1.0, 0.001, dtype=np.float32)
    way = np.stack([engagements.motion.position(np.full(8, time)) for time in times])
    assert np.all(np.abs(way[..., 0] - 3.0) < 0.3)
    speed = np.linalg.norm(np.diff(way, axis=0), axis=-1) / 0.001
    assert speed.max() <= (0.01 if motion == "still" else 1.1)


def test_a_pellet_flies_from_the_muzzle_to_its_miss(subject: Subject, choice: Choice) -> None:
    trial = run_trial(subject, choice)
    fired, flight = trial.fired_at[30], trial.flight_time[1, 30]
    assert np.allclose(moment(trial, 1, fired + 1e-4).pellets[-1], [0, 0, 0], atol=0.01)
    before = moment(trial, 1, fired + flight - 1e-4)
    first = before.pellets[0]
    np.testing.assert_allclose(first[1:] - before.place[1:], trial.miss[1, 30], atol=5e-3)
    after = moment(trial, 1, fired + flight + 1e-6)
    assert len(after.misses) == len(before.misses) + 1
    assert len(after.pellets) == len(before.pellets) - 1


def test_the_score_grows_with_time_and_has_an_interval_after_two_engagements(subject: Subject, choice: Choice) -> None:
    trial = run_trial(subject, choice)
    assert score(trial, 0, 0.0)[:2] == (0, 0)
    middle, end = score(trial, 0, 0.6), score(trial, 3, trial.shown_s)
    assert 0 < middle.landed < 50
    assert middle.so_far is None
    assert score(trial, 1, 0.5).so_far is None
    assert score(trial, 2, 0.0).so_far is not None
    assert end.so_far is not None
    assert (end.so_far.hits, end.so_far.shots) == (int(trial.hit.sum()), 200)


def test_what_makes_no_trial_is_refused(subject: Subject, choice: Choice) -> None:
    assert "kalman" in controller_names(subject)
    wrong = [{"controller": "nobody"}, {"motion": "sideways"}, {"engagements": 1}, {"distance": 0.0}]
    wrong += [{name: value} for name in RANGES for value in (np.nan, np.inf, -0.01, 1e3)]
    for changes in wrong:
        with pytest.raises(InputError, match=next(iter(changes)).replace("_", " ")):
            run_trial(subject, replace(choice, **changes))


@pytest.mark.parametrize("field", ["motion", "controller"])
def test_a_foreign_word_loads_no_code(subject: Subject, choice: Choice, tmp_path: Path, field: str) -> None:
    trap, trace = tmp_path / "trap.py", tmp_path / "was_run"
    trap.write_text(f"open({str(trace)!r}, 'w')\ndef Thing(*_): pass\n")
    foreign = replace(choice, **{field: f"{trap}:Thing"})
    with pytest.raises(InputError, match=f"{field} must be one of"):
        run_trial(subject, foreign)
    with pytest.raises(InputError, match=f"{field} must be one of"):
        HandRun(subject, replace(foreign, motion=HAND) if field == "controller" else foreign, np.array([3.0, 0.0, 0.0]))
    # Nor where nothing was checked before.
    with pytest.raises(InputError, match="must be one of"):
        meet(f"{trap}:Thing", 3.0, 0.5, subject.conditions, 2, 1, 0)
    with pytest.raises(InputError, match="must be one of"):
        chosen_controller(subject, replace(choice, controller=f"{trap}:Thing"))
    assert not trace.exists()


OWN = """
from typing import NamedTuple
import numpy as np
from archerfish.sensing.interfaces import fire_always
class Base(NamedTuple):
    gain: float = 1.0
    @classmethod
    def build(cls, bench): return cls()
    def reset(self, seen, truth=None): return seen.angle
    def step(self, state, seen): return self.answer(state, seen)
class Good(Base):
    def answer(self, state, seen): return seen.angle, fire_always(0.0 * seen.angle)
class Raising(Base):
    def answer(self, state, seen): raise ValueError("no")
class Nan(Base):
    def answer(self, state, seen): return state, fire_always(np.nan * seen.angle)
class Narrow(Base):
    def answer(self, state, seen): return state, fire_always(seen.angle[:1])
class Forgetful(Base):
    def answer(self, state, seen): return state[:, 0], fire_always(seen.angle)
class Loose(Base):
    def answer(self, state, seen): return seen.angle
class Dead(Base):
    def reset(self, seen, truth=None): raise KeyError("gone")
"""


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("Good", ""),
        ("Raising", r"own.py:Raising: line \d+: ValueError: no"),
        ("Nan", "own.py:Nan: step commands angle that are not finite"),
        ("Narrow", r"own.py:Narrow: step commands angle of shape \(1, 2\) for \d engagements"),
        ("Forgetful", "own.py:Forgetful: step returns another state"),
        ("Loose", "own.py:Loose: step returns an array"),
        ("Dead", r"own.py:Dead: line \d+: KeyError"),
    ],
)
def test_a_controller_of_a_user_s_own_is_watched(
    subject: Subject, choice: Choice, tmp_path: Path, name: str, told: str
) -> None:
    (tmp_path / "own.py").write_text(OWN)
    known = replace(subject, own_controllers={name: find_controller(f"{tmp_path}/own.py:{name}")})
    for motion in ("still", HAND):
        chosen = replace(choice, controller=name, motion=motion)

        def play(chosen: Choice = chosen) -> None:
            if chosen.motion != HAND:
                run_trial(known, chosen)
            else:
                HandRun(known, chosen, np.array([3.0, 0.0, 0.0])).step(np.array([3.0, 0.0, 0.0]))

        if not told:
            play()
        elif not (name == "Narrow" and motion == HAND):  # of one engagement, one is right
            with pytest.raises(InputError, match=told):
                play()


def test_controllers_and_motions_of_a_user_s_own_are_played(subject: Subject, choice: Choice) -> None:
    controller = find_controller(f"{EXAMPLES}/two_frames.py:TwoFrames")
    motion = find_motion(f"{EXAMPLES}/departure.py:Departure")
    known = replace(subject, own_controllers={"TwoFrames": controller}, own_motions={"Departure": motion})
    chosen = replace(choice, controller="TwoFrames", motion="Departure", speed=0.5)
    check_choice(known, chosen)
    trial = run_trial(known, chosen)
    assert 0.0 < trial.hit.mean() < 1.0
    # It stands for half a second at most, then leaves at the chosen speed.
    way = np.linalg.norm(np.diff(trial.place[:, -20:], axis=1), axis=-1) / trial.period_s
    np.testing.assert_allclose(way, 0.5, rtol=1e-3)


STRAIGHT = """
from typing import NamedTuple
from archerfish.dynamics.array_namespace import namespace
class Straight(NamedTuple):
    place: object
    velocity: object
    @classmethod
    def draw(cls, place, speed, chance):
        xp = namespace(place)
        return cls(place, xp.stack([0.0 * speed, speed, 0.0 * speed], axis=-1))
    def position(self, time):
        return self.place + self.velocity * time[:, None]
class Failing(Straight):
    def position(self, time):
        if not hasattr(time, "aval") and time.max() > 0.45:
            raise ValueError("too late")
        return Straight.position(self, time)
"""


def test_a_motion_of_a_user_s_own_is_asked_for_one_time_of_each_target_as_in_the_simulator(
    subject: Subject, choice: Choice, tmp_path: Path
) -> None:
    (tmp_path / "own.py").write_text(STRAIGHT)
    known = replace(subject, own_motions={"Straight": find_motion(f"{tmp_path}/own.py:Straight")})
    trial = run_trial(known, replace(choice, motion="Straight", speed=0.5))
    times = trial.period_s * np.arange(trial.place.shape[1])
    np.testing.assert_allclose(trial.place[..., 1] - trial.place[:, :1, 1], np.tile(0.5 * times, (4, 1)), atol=1e-5)
    assert np.all(np.isfinite(trial.error))


def test_a_motion_that_fails_beyond_the_engagement_is_named(subject: Subject, choice: Choice, tmp_path: Path) -> None:
    (tmp_path / "own.py").write_text(STRAIGHT.replace("0.45", str(subject.conditions.engagement_s + 0.2)))
    known = replace(subject, own_motions={"Failing": find_motion(f"{tmp_path}/own.py:Failing")})
    with pytest.raises(InputError, match=r"own.py:Failing: line \d+: ValueError: too late"):
        run_trial(known, replace(choice, motion="Failing"))


WITHHOLDING = """
from typing import NamedTuple
from archerfish.dynamics.aiming import line_of_sight
from archerfish.sensing.interfaces import fire_always
class Half(NamedTuple):
    every: float = 2.0
    @classmethod
    def build(cls, bench): return cls()
    def reset(self, seen, truth=None): return 0.0 * seen.elapsed
    def step(self, state, seen):
        command = fire_always(line_of_sight(seen.plate[..., 0, :]))
        return state + 1.0, command._replace(fire=state % self.every == 0.0)
class Always(Half):
    @classmethod
    def build(cls, bench): return cls(1.0)
class Never(Half):
    @classmethod
    def build(cls, bench): return cls(1e9)
    def reset(self, seen, truth=None): return 1.0 + 0.0 * seen.elapsed
"""


@pytest.fixture
def withholding(subject: Subject, tmp_path: Path) -> Subject:
    (tmp_path / "own.py").write_text(WITHHOLDING)
    names = ("Half", "Always", "Never")
    return replace(subject, own_controllers={name: find_controller(f"{tmp_path}/own.py:{name}") for name in names})


def test_a_pellet_that_was_not_fired_is_neither_drawn_nor_scored(withholding: Subject, choice: Choice) -> None:
    half, always, never = (
        run_trial(withholding, replace(choice, controller=name, motion="still")) for name in ("Half", "Always", "Never")
    )
    assert np.array_equal(half.hit, always.hit & half.fired)
    end = half.shown_s
    for time in (0.4, 0.7, end):
        shown, whole = moment(half, 1, time), moment(always, 1, time)
        assert len(shown.misses) == score(half, 1, time).landed == (len(whole.misses) + 1) // 2
        assert len(shown.pellets) <= (len(whole.pellets) + 1) // 2
        assert np.array_equal(shown.misses, whole.misses[::2])
    assert score(half, 3, end).so_far == hit_rate(always.hit[:, ::2])
    assert count_words(half) == f"{half.hit.sum()} of 100 hit, 100 withheld"
    assert len(moment(never, 0, end).misses) == len(moment(never, 0, 0.5).pellets) == 0
    assert rate_words(score(never, 3, end).so_far) == "no shot in 4 engagements"
    assert difference_words("Half", "Never", compared(half, never)).endswith("one of them fired no shot")


def test_a_dragged_target_is_shot_at_with_fired_pellets_alone(withholding: Subject, choice: Choice) -> None:
    dragged = replace(choice, motion=HAND, dispersion=0.0)
    half, always = (
        HandRun(withholding, replace(dragged, controller=name), np.array([3.0, 0.0, 0.0]))
        for name in ("Half", "Always")
    )
    for run in (half, always):
        for _ in range(60):
            run.step(np.array([3.0, 0.0, 0.0]))
    ours, theirs = half.trial(), always.trial()
    assert np.array_equal(ours.hit, theirs.hit & ours.fired)
    assert np.array_equal(np.isfinite(ours.flight_time), np.isfinite(theirs.flight_time) & ours.fired)
    shown, whole = moment(ours, 0, half.elapsed), moment(theirs, 0, half.elapsed)
    assert np.array_equal(shown.misses, whole.misses[::2])
    assert 0 < len(shown.pellets) < len(whole.pellets)
    # The aim of every decision is judged, whether it fires or not.
    assert np.array_equal(np.isfinite(ours.error), np.isfinite(theirs.error))
