"""Evaluations: what is paired, named, counted, tuned, refused and shown."""

import json
import math
from contextlib import contextmanager
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import archerfish as af
from archerfish.controllers.aiming.oracle import make_oracle
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.controllers.policy.observation import make_observer, observer_facts
from archerfish.controllers.policy.policy import PolicyFacts
from archerfish.controllers.registry import make_controller
from archerfish.controllers.tuning import GRIDS, tuning_at
from archerfish.evaluation import tuning_search as tuning
from archerfish.evaluation.contenders import as_contenders
from archerfish.evaluation.draws import draw
from archerfish.evaluation.run import count
from archerfish.protocols import aim

ROBOT, TASK, PAPER = af.Robot.paper(), af.Task.load("dynamic").replace(ranges_m=((2, 3),)), af.Task.load("paper")
OTHER = ROBOT.replace(name="other", muzzle=ROBOT.muzzle.replace(speed=15.0))
RATES = tuning.rates
BEST = (3, -1, 0, 2)  # on the grids of kalman


def rate(settings):
    """A hill over the grids of kalman, which would go on beyond the bound of the velocity's decay."""
    steps = math.log2(settings.acceleration_sd / 4.0) - BEST[0], math.log2(settings.initial_speed / 0.25) - BEST[1]
    steps += (5.0 * (settings.velocity_decay - 1.2), settings.extra_lead_s / 0.02 - BEST[3])
    return 0.9 - 0.01 * sum(each**2 for each in steps)


class Held:
    """Aims where the target is, or beside it at some decisions, and fires every n-th."""

    compiled = False

    def __init__(self, every=1, added=None):
        self.inner, self.every, self.added = make_controller("no-lead", ROBOT, TASK), every, added or {}

    def reset(self, seen, truth=None):
        return 0, self.inner.reset(seen)

    def step(self, state, seen):
        inner, command = self.inner.step(state[1], seen)
        fire = (0.0 * seen.elapsed + state[0]) % self.every == 0.0
        return (state[0] + 1, inner), aim(command.angle + self.added.get(state[0], 0.0))._replace(fire=fire)


def policy(kind="history", robot=ROBOT, task=PAPER, seed=0):
    """A policy that aims where its observer does."""
    facts = observer_facts(kind, robot, task)
    observer = make_observer(facts)
    size = sum(each for _, each in observer.layout())
    zeros, ones = np.zeros(size, np.float32), np.ones(size, np.float32)
    actor = (Layer(np.zeros((size, 2), np.float32), np.zeros(2, np.float32)),)
    facts = PolicyFacts(observer=facts, task=task, robot=robot.record_digests(), seed=seed)
    return af.Policy(observer, Normaliser(zeros, ones, np.float32(0.0)), actor, facts=facts)


def short(robot, task):
    """A controller for engagements of half a second alone."""
    return {(0.5,): Held()}[task.lengths_s]


ELSEWHERE = Held()  # a policy of another robot, as far as an evaluation looks
ELSEWHERE.facts = PolicyFacts(observer=observer_facts("paper", ROBOT, TASK), task=TASK, robot={"pitch": "another"})
COUNTS = [*product(("engagements", "seed"), ("10", 10.0, True, -1)), ("engagements", 1), ("engagements", 10**9)]
REFUSED = [
    # The first two are found at some decision, the others before anything is shot.
    ("controllers", Held(added={3: ()}), r"test_evaluate.py:Held: line \d+: ValueError: .* broadcast.*; correct it"),
    ("controllers", Held(added={9: math.nan}), "a pitch of nan rad at decision 10, in 4 of 4 engagements, expected"),
    ("controllers", ELSEWHERE, "was trained for another robot than paper; name that robot's folder"),
    ("controllers", (), "there is none; give one"),
    ("controllers", ("kalman", "kalmn"), "got 'kalmn'; perhaps you meant kalman"),
    ("controllers", Path("nowhere"), "controller must be one of kalman, .*, got 'nowhere'"),
    ("controllers", {"": "no-lead"}, "controllers: a name must have 1…1000 characters, got ''"),
    ("controllers", ["no-lead", ["kalman"]], "controller: expected a name, .* got one of type list; give"),
    ("controllers", ("no-lead", short), r"test_evaluate.py:short: line \d+: KeyError"),
    ("robot", OTHER, "kalman-paper has settings of the paper's robot alone, got other"),
    ("world", object(), "world: expected ./FILE.py:NAME, .* got one of type object"),
    *((name, value, f"{name} must be a whole number, .*, got {value!r}; choose another") for name, value in COUNTS),
]


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch):
    """Evaluate in NumPy, where a test asks for nothing else: to compile takes longer than some engagements."""
    monkeypatch.setattr("archerfish.evaluation.run.has_jax", lambda: False)


@pytest.fixture
def searched(monkeypatch):
    """Names that were searched for, on the hill instead of in a simulator."""
    names = []
    monkeypatch.setattr(tuning, "rates", lambda name, robot, task: names.append(name) or rate)
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    return names


def test_equal_names_get_a_number_and_all_have_the_same_engagements_and_dispersion():
    results = af.evaluate(["no-lead", Held(), "no-lead", Held()], task=TASK, engagements=4)
    assert [each.controller for each in results.cells] == ["no-lead", "Held", "no-lead-2", "Held-2"]
    assert len({each.hits_by_engagement for each in results.cells}) == 1
    assert af.evaluate("no-lead", task=TASK, engagements=4, seed=1).cells[0].hits != results.cells[0].hits


def test_a_cell_of_two_tasks_is_joined_once():
    beside = af.evaluate("no-lead", task=TASK.replace(motion="paper"), engagements=4)
    results = af.evaluate(["no-lead", Held()], task=TASK, engagements=4)
    assert beside.cells[1].hits == results.cells[0].hits
    assert {each.key for each in beside.join(results).cells} == {each.key for each in beside.cells[:1] + results.cells}


def test_engagements_have_room_in_memory_and_in_the_file_of_results(refused, monkeypatch, tmp_path):
    refused("engagements must be a whole number, 1….* room for", af.rollout, "no-lead", task=TASK, engagements=10**9)
    monkeypatch.setattr("archerfish.evaluation.draws.MOST_COUNTS", 2 * 2 * 4)  # cells, controllers, engagements
    task = TASK.replace(ranges_m=((1.0, 2.0), (2.0, 3.0)))
    pair = ["no-lead", Held()]
    refused("2…4, which results.json has room for, got 5", af.evaluate, pair, task=task, engagements=5)
    monkeypatch.setattr("archerfish.evaluation.results.MOST_COUNTS", 15)
    results = af.evaluate(pair, task=task, engagements=4)
    refused(r"more.json: 16 engagements of all cells, .* at most 15", results.save, tmp_path / "more.json")


def test_progress_says_which_controller_is_compiled_first(monkeypatch):
    pytest.importorskip("jax")
    monkeypatch.setattr("archerfish.evaluation.run.has_jax", lambda: True)
    shown = []

    @contextmanager
    def bar(*_):
        yield lambda *progress: shown.append(progress)

    monkeypatch.setattr("archerfish.reports.progress.bar", bar)
    af.evaluate(["no-lead", Held()], task=TASK, engagements=4)
    assert shown == [(0, "compiling, no-lead"), (200, "no-lead"), (200, "Held"), (400, "Held")]


def test_a_decision_without_fire_is_a_miss_and_changes_no_other_shot():
    (cell,) = af.evaluate(Held(every=2), task=TASK, engagements=4).cells
    hit = af.rollout(Held(), task=TASK, engagements=4).hit
    assert (cell.hits, cell.shots, cell.withheld, cell.decisions) == (hit[:, ::2].sum(), 100, 100, 200)


def test_the_papers_figures_stand_beside_what_is_the_papers_alone():
    both, paper = PAPER.replace(ranges_m=((2, 3),)), policy("paper")
    given = {"ours": paper, "again": policy("paper", seed=1), "history": policy(), "kalman": "kalman-paper"}
    given["strafe"] = policy("paper", task=PAPER.replace(motion="strafe"))
    results = af.evaluate(given, ROBOT, both, engagements=2)
    assert {cell.table for cell in results.cells} == {"II", "III"}
    assert {cell.controller for cell in results.cells if cell.paper} == {"ours", "again", "kalman"}
    assert [repr(results).count(f"paper: {name} (printed)") for name in ("PPO", "Kalman")] == [2, 2]
    departure = Path(__file__).parents[2] / "examples" / "departure.py"
    wide, fast, own = ({"hit_radius_m": 0.3}, {"max_speed_m_s": 1.0}, {"motion": f"{departure}:departure"})
    for robot, changes in ((ROBOT, wide), (ROBOT, fast), (ROBOT, own), (OTHER, {})):
        unlike = af.evaluate({"ours": paper}, robot, both.replace(**changes), engagements=2)
        assert {(cell.table, cell.paper) for cell in unlike.cells} == {(None, None)}


def test_a_field_that_is_not_as_usual_stands_in_the_heading():
    results = af.evaluate("no-lead", ROBOT, TASK.replace(hit_radius_m=0.3, name="large"), engagements=2)
    assert "dynamic targets: paper, task large, limit gate, engagements of 1 s; hit_radius_m 0.3\n" in repr(results)


def test_what_is_unlike_the_training_of_a_policy_is_said():
    ours = {"ours": policy(), "kalman": "no-lead"}
    assert af.evaluate(ours, ROBOT, TASK, engagements=2).remarks == ()
    results = af.evaluate(ours, OTHER, TASK.replace(motion="pass", command_limit="box", lateral_m=0.1), engagements=2)
    unlike = "targets paper (here pass), limit gate (here box), lateral_m 0.7 (here 0.1), another robot's records"
    assert results.remarks == (f"ours was trained for {unlike}; task paper is that of its training.",)
    assert f"{results.remarks[0]}" in repr(results).replace("\n", " ")
    assert results.remarks[0] in results.report.doubts


def test_accelerations_count_from_the_rest_that_an_engagement_begins_with():
    task = TASK.replace(motion="static", start=(0.0, 0.3))
    (cell,) = af.evaluate("no-lead", task=task, engagements=4).cells
    shots = af.rollout("no-lead", task=task, engagements=4)
    yaw = np.stack([shots.in_force, shots.shot.angle])[..., 1].astype(float)
    bends = np.diff(np.pad(yaw, ((0, 0), (0, 0), (2, 0)), constant_values=0.3), n=2)
    assert cell.yaw_rad_s2 == pytest.approx(np.abs(bends).max() / 0.02**2, rel=1e-2)


def test_a_fault_of_ours_keeps_its_traceback(monkeypatch):
    def step(self, state, seen):
        raise KeyError("ours")

    monkeypatch.setattr("archerfish.controllers.aiming.direct.DirectAim.step", step)
    with pytest.raises(KeyError, match="ours"):
        af.rollout("kalman-paper", task=TASK, engagements=4)


def test_a_search_finds_the_best_setting_and_tries_all_beside_it():
    found = tuning.search("kalman", rate)
    tried = [settings for settings, _ in found.tried]
    assert (found.tuning, found.hit_rate) == (tuning_at("kalman", BEST), max(value for _, value in found.tried))
    for (axis, grid), by in product(enumerate(GRIDS["kalman"].values()), (-1, 1)):
        beside = tuning_at("kalman", (*BEST[:axis], BEST[axis] + by, *BEST[axis + 1 :]))
        assert (beside in tried) == (grid.last is None or by < 0)
    endless = tuning.search("kalman", lambda settings: 0.5 + settings.extra_lead_s - math.log(settings.initial_speed))
    assert len(tried) < len(endless.tried) <= tuning.BUDGET


def test_what_is_tuned_shoots(searched):
    best = tuning_at("kalman", BEST)
    settings = "kept", {"kalman": best}, "start"
    tuned, given, start = (af.evaluate("kalman", OTHER, TASK, engagements=4, seed=1, tuning=each) for each in settings)
    assert tuned.tuning == given.tuning == {"other/gate/dynamic/kalman": best}
    assert start.tuning == {"other/gate/dynamic/kalman": tuning_at("kalman")}
    assert start.remarks == ('Classical controllers have the settings where the search begins (tuning="start").',)
    world, controller = af.make_world(OTHER, TASK), make_controller("kalman", OTHER, TASK, best)
    hit = count(world, controller, *draw(TASK.cells(), 4, 1, "evaluation")).hit
    assert tuned.cells[0].hits_by_engagement == given.cells[0].hits_by_engagement == (*hit.sum(axis=1),)
    assert hit.sum() != start.cells[0].hits
    shots = af.rollout("kalman", OTHER, TASK, engagements=4, seed=1, tuning=best)
    assert shots.hit.sum() == hit.sum()


def test_the_rate_that_is_tuned_is_of_other_draws(searched, monkeypatch):
    best = tuning_at("kalman", BEST)
    world, controller = af.make_world(OTHER, TASK), make_controller("kalman", OTHER, TASK, best)
    monkeypatch.setattr(tuning, "ENGAGEMENTS", 32)
    expected = count(world, controller, *draw(TASK.cells(), 4, 0, "tuning")).hit.mean()
    assert RATES("kalman", OTHER, TASK)(best) == pytest.approx(expected)


def test_a_terminal_shows_tuning_and_evaluation(searched, monkeypatch, capsys):
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    results = af.evaluate(["kalman", "no-lead"], OTHER, TASK, engagements=4)
    shown = capsys.readouterr().err
    texts = ("tuning", "settings/s", "kalman, best 89.", "evaluating", "no-lead", "400/400")
    assert [text for text in texts if text not in shown] == []
    assert {*results.durations} == {"checks", "tuning", "evaluation"}


def test_what_is_no_tuning_is_refused(refused):
    for value in ("best", {"kalmn": 1}, {"kalman": 2}):
        refused("tuning: expected .*a Tuning", af.evaluate, "kalman", task=TASK, tuning=value)


def test_a_controller_is_made_once_for_each_length(monkeypatch):
    made = []
    build = "archerfish.controllers.registry.make_oracle"
    monkeypatch.setattr(build, lambda robot, task: made.append(task.lengths) or make_oracle(robot, task))
    results = af.evaluate("oracle", task=TASK.replace(lengths_s=(0.5, 1.0)), engagements=4)
    assert (made, len(results.cells)) == ([(0.5,), (1.0,)], 2)


def test_trainings_that_differ_in_more_than_their_seed_are_two_controllers():
    trained = [policy(), policy(seed=1), policy("paper", seed=2)]
    found = as_contenders(trained)
    assert [f"{each.name} {each.seed}" for each in found] == ["policy 0", "policy 1", "policy-2 2"]


def test_a_world_of_one_s_own_is_not_joined_with_ours_of_that_name(refused):
    ours = af.evaluate("no-lead", task=TASK, engagements=2)
    own = af.evaluate("no-lead", task=TASK, engagements=2, world=lambda robot, task: af.make_world(robot, task))
    refused("robots: paper differs", ours.join, own)


def test_a_motion_of_one_s_own_has_not_the_name_of_ours(refused):
    def strafe(place, speed, uniforms):
        """A motion that is never called."""

    refused("strafe is the name of a motion of ours", af.evaluate, "no-lead", task=strafe)


def test_a_tuning_is_kept_for_its_robot_and_task(searched, tmp_path, monkeypatch):
    monkeypatch.setenv("ARCHERFISH_CACHE", str(tmp_path / "cache"))
    OTHER.save(tmp_path)
    places = [af.Robot.load(tmp_path), OTHER]  # a robot's folder, and the user's cache
    for robot, name in product(places * 2, ("one", "another")):
        assert af.tune("kalman", robot, TASK.replace(name=name)) == tuning_at("kalman", BEST)
    assert (len(searched), len([*tmp_path.glob("tuning.json"), *tmp_path.glob("cache/tuning/*.json")])) == (2, 2)
    af.tune("kalman", places[0], TASK.replace(command_limit="box"))
    af.tune("kalman", OTHER.replace(muzzle=ROBOT.muzzle.replace(speed=16.0)), TASK)
    assert len(searched) == 4
    monkeypatch.setenv("ARCHERFISH_CACHE", "off")
    af.tune("kalman", OTHER, TASK)
    for lengths in ((), (1.0,)):
        af.tune("kalman", ROBOT, af.Task.load("paper").replace(lengths_s=lengths))  # comes with Archerfish
    assert len(searched) == 5
    for field in ("version", "grids"):  # of another version of the program, or of code that was edited
        content = json.loads((tmp_path / "tuning.json").read_text())
        (tmp_path / "tuning.json").write_text(json.dumps(content | {"tunings": [content["tunings"][0] | {field: "?"}]}))
        af.tune("kalman", places[0], TASK)
    assert len(searched) == 7


def test_a_name_without_settings_is_not_tuned(refused):
    for name in ("kalmn", "no-lead", "kalman-paper", 3):
        refused(f"controller must be one of kalman, .*, got {name!r}", af.tune, name, ROBOT, PAPER)


def test_without_jax_the_counts_are_the_same(run_python, monkeypatch):
    monkeypatch.undo()
    code = "import archerfish as a\nprint([x.hits for x in a.evaluate(['kalman'], task='paper', engagements=4).cells])"
    here = [each.hits for each in af.evaluate(["kalman"], task="paper", engagements=4).cells]
    assert run_python(code, blocked=("jax",)) == f"{here}\n"


@pytest.mark.parametrize(("name", "value", "complaint"), REFUSED)
def test_what_can_not_be_evaluated_is_refused_before_a_shot(name, value, complaint, refused, monkeypatch):
    monkeypatch.setattr(tuning, "rates", None)
    if value not in [late for _, late, _ in REFUSED[:2]]:
        monkeypatch.setattr("archerfish.evaluation.evaluate.count", None)
    usual = {"controllers": ("no-lead", "kalman-paper"), "task": TASK.replace(lengths_s=(0.5, 1.0)), "engagements": 4}
    refused(complaint, af.evaluate, **usual | {name: value})
