"""What policies see and command, and their files."""

import dataclasses
import itertools
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from archerfish.arrays import leaves, map_arrays, single_precision
from archerfish.controllers.policy.blocks import OBSERVATIONS
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.controllers.policy.observation import make_observer, observer_facts
from archerfish.controllers.policy.policy import Policy, PolicyFacts
from archerfish.dynamics.muzzle import pellet_at_muzzle
from archerfish.dynamics.pellet import flat_fire_crossing
from archerfish.protocols import Barrel, Base, Frames, GimbalFeedback, Seen
from archerfish.records.json_files import plain
from archerfish.robot import Robot
from archerfish.task import Task
from archerfish.tracking.legendre_memory import constant_history, legendre_window, with_sample

PAPER = Robot.paper()
SENSING = Robot.load(Path(__file__).parents[1] / "infantry").replace(muzzle=PAPER.muzzle)  # without offsets
TASK, SIZES = Task.load("paper"), {"paper": 6, "history": 35, "tracked": 55, "multimodel": 120}
TRACKING = ("tracked", "multimodel")


def facts(kind):
    return observer_facts(kind, SENSING if kind == "tracked" else PAPER, TASK)


def observers(kind):
    """An observer, and the same with commands that may jump."""
    observer, wide = make_observer(facts(kind)), np.full(2, 1e3, np.float32)
    return observer, dataclasses.replace(observer, largest_move=wide, braking=wide)


def sequence(batch, steps=8, mirror=1.0, turn=0.0, shift=(0.0, 0.0, 0.0), drive=(0.0, 0.0, 0.0), frames=1, slots=1):
    """Decisions at which a target drives past; in a mirror, turned about the vertical, seen from another base."""
    rng, zero = np.random.default_rng(3), np.zeros(batch)
    shift, drive, found = np.array(shift), np.array(drive), []
    rotation = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    speed, begin = rng.uniform(-1.0, 1.0, batch), rng.uniform(-0.3, 0.3, batch)
    for step in range(steps):
        angle, command = (rng.normal(0.0, 0.05, (*batch, 2)) * [1.0, mirror] + [0.0, turn] for _ in range(2))
        age = 0.03 - 0.005 * np.arange(frames) + np.zeros((*batch, frames))
        y = mirror * (begin[..., None] + speed[..., None] * (0.02 * step - age))
        place = np.stack([3.0 + 0.0 * y, y, 0.1 + 0.0 * y], axis=-1)[..., None, :]
        place = np.repeat(place, slots, axis=-2) + mirror * np.arange(slots)[:, None] * [0.0, 0.5, 0.0]
        own = shift + drive * (0.02 * step - age[..., None])
        shown = np.full((*batch, frames, slots), step != 3)
        place = np.where(shown[..., None], place @ rotation + own[..., None, :], 0.0)
        seen = Frames(np.ones((*batch, frames), bool), age, shown, place, 0.0 * place[..., 0])
        pivot, velocity = (np.broadcast_to(each, (*batch, 3)) for each in (shift + 0.02 * step * drive, drive))
        base = Base(pivot, velocity, zero + shift[0], zero + drive[0])
        gimbal = GimbalFeedback(angle, 0.0 * angle, zero + 0.002)
        found.append(Seen(zero + 0.02 * (step > 0), gimbal, command, seen, base, Barrel(zero + 18.0, zero)))
    return single_precision(tuple(found))


def seen_at(place, command=(0.0, 0.0), lag=(0.0, 0.0), elapsed=0.02, age=0.045):
    """A decision of one robot that sees one plate."""
    flat, command = np.zeros(()), np.asarray(command)
    frames = Frames(np.array([True]), np.array([age]), np.array([[True]]), np.array([[place]]), np.zeros((1, 1)))
    gimbal = GimbalFeedback(command - lag, np.zeros(2), flat + 0.01)
    base = Base(np.zeros(3), np.zeros(3), flat, flat)
    return single_precision(Seen(flat + elapsed, gimbal, command, frames, base, Barrel(flat, flat)))


def remembered(observer, seen):
    memory = observer.begin(seen[0])
    for each in seen:
        memory = observer.remember(memory, each)
    return memory


def observed(observer, seen, action=0.5):
    """Observations and commands, decision by decision."""
    memory, found = observer.begin(seen[0]), []
    for each in seen:
        memory = observer.remember(memory, each)
        view = observer.view(memory)
        found.append((observer.observe(view), observer.decode(view, action + 0.0 * view.aim).angle))
    return tuple(found)


def by_block(observer, numbers):
    names, sizes = zip(*observer.layout(), strict=True)
    return dict(zip(names, np.split(numbers, np.cumsum(sizes)[:-1], axis=-1), strict=True))


BOTH = [(kind, batch) for kind in OBSERVATIONS for batch in ((), (3,), (2, 3)) if kind not in TRACKING]
LARGE = [pytest.param(kind, batch, marks=pytest.mark.slow) for kind in TRACKING for batch in ((), (3,))]  # to compile


@pytest.mark.parametrize(("kind", "batch"), [*BOTH, *((kind, (2, 3)) for kind in TRACKING), *LARGE])
def test_numpy_and_jax_observe_and_command_alike(kind, batch, agree):
    agree(observed, make_observer(facts(kind)), sequence(batch, 2, frames=2, slots=2), rtol=1e-4, atol=2e-4)


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_one_robot_sees_what_it_sees_in_a_batch_and_left_and_right_are_mirror_images(kind):
    observer = make_observer(facts(kind))
    assert sum(size for _, size in observer.layout()) == SIZES[kind]
    together, image = (observed(observer, sequence((2, 3), frames=2, mirror=side), 0.0) for side in (1.0, -1.0))
    alone = observed(observer, map_arrays(lambda each: each[1, 2], sequence((2, 3), frames=2)), 0.0)
    assert_allclose(alone[-1][0], together[-1][0][1, 2], atol=1e-3)
    assert_allclose([each for _, each in image], [each * [1.0, -1.0] for _, each in together], atol=1e-5)
    numbers, mirrored = (np.stack([each for each, _ in found])[2:] for found in (together, image))
    same, opposite = (np.isclose(sign * mirrored, numbers, atol=1e-4).all((0, 1, 2)) for sign in (1.0, -1.0))
    assert np.all(same | opposite)
    assert np.sum(~same) == {"paper": 3, "history": 16, "tracked": 35, "multimodel": 70}[kind]


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_only_where_the_target_is_from_the_base_counts(kind):
    observer, turn = make_observer(facts(kind)), 3.17  # half a turn: one target passes straight behind
    cases = {}, {"shift": (0.5, -0.25, 0.125)}, {"turn": turn}
    plain, elsewhere, turned = (observed(observer, sequence((4,), **each), 0.0) for each in cases)
    for (numbers, angle), (same, command), (others, beyond) in zip(plain, elsewhere, turned, strict=True):
        assert_allclose(same, numbers, atol=2e-3)
        assert_allclose([command - angle, beyond - angle - [0.0, turn]], 0.0, atol=1e-5)
        off = by_block(observer, others - numbers)
        for name in off.keys() & {"paper", "aimed", "aim_yaw"}:  # which alone have the yaw itself
            off[name] -= 2.0 * turn * np.array({"paper": [0, 1, 0, 1, 1, 0], "aimed": [0, 1], "aim_yaw": [1]}[name])
        assert_allclose(np.concatenate([*off.values()], axis=-1), 0.0, atol=3e-3)


@pytest.mark.parametrize("kind", TRACKING)
def test_once_the_tracks_are_begun_a_base_that_drives_sees_what_one_that_stands_does(kind):
    observer = make_observer(facts(kind))
    driven = [sequence((4,), steps=60, drive=each) for each in ((0.0, 0.0, 0.0), (0.5, -1.0, 0.0))]
    (numbers, angle), (same, command) = (observed(observer, each, 0.0)[-1] for each in driven)
    off = by_block(observer, same - numbers)
    kept = [each for name, each in off.items() if name not in ("models", "slow")]  # what stands, stands in the world
    assert_allclose(np.concatenate(kept, axis=-1), 0.0, atol=2e-3)
    if kind == "multimodel":
        assert_allclose(off["models"][:, 5:9], 0.0, atol=2e-2)  # speeds of what drives on
    assert_allclose(command, angle, atol=1e-5)


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_zero_aims_at_where_the_target_is_now_or_was_seen_and_one_is_an_action_scale(kind):
    free, speed = observers(kind)[1], np.array([-0.2, 0.6, 0.0])
    seen = [seen_at([3.0, -0.5, 0.1] + speed * (0.02 * step - 0.045)) for step in range(50)]
    view, zero = free.view(remembered(free, seen)), np.zeros(2, np.float32)
    aim = free.decode(view, zero).angle
    time, position = 0.98 - 0.045 * (kind not in TRACKING), pellet_at_muzzle(free.muzzle, aim, zero, np.zeros(3))
    target = [3.0, -0.5, 0.1] + time * speed
    crossing = flat_fire_crossing(*position, target[0], free.muzzle.drag)
    assert_allclose([crossing.lateral, crossing.height], target[1:], atol=2e-3)
    if kind in TRACKING:
        seen_then, now = (np.arctan2(y, x) for x, y in (target[:2] - 0.045 * speed[:2], target[:2]))
        found = by_block(free, free.observe(view))
        assert_allclose(found["detection"], 100.0 * (seen_then - now), atol=0.03)
        assert_allclose(found["bearings"][-1], 20.0 * np.hypot(*target[:2]) * (seen_then - now), atol=0.02)
    assert_allclose(free.decode(view, np.array([1.0, -0.5], np.float32)).angle - aim, [0.03, -0.05], rtol=1e-4)


@pytest.mark.parametrize("kind", ["history", *TRACKING])
def test_blocks_are_scaled_as_by_hand(kind):
    observer, free = observers(kind)
    place, lag, move = np.array([4.0, 0.5, 0.1]), np.array([0.01, -0.03]), np.array([0.002, 0.01])
    aim = free.decode(free.view(free.begin(seen_at(place))), np.zeros(2, np.float32)).angle
    commands = aim - [[0.05, 0.1]] + move * np.arange(6)[:, None]
    seen = [seen_at(place, each, lag * (step - 4), 0.02 * (step > 0)) for step, each in enumerate(commands)]
    found = by_block(observer, observer.observe(observer.view(remembered(observer, seen))))
    error, rest = aim - commands[-1] + lag, aim - commands[-1] - move**2 / (2.0 * observer.braking)
    for name, off in (("error", error), ("rest", rest)):
        assert_allclose(found[name], [*2.0 * off, *np.tanh(100.0 / 3.0 * off)], atol=1e-4)
    assert_allclose(found["lag"], [0.0, 0.0, *2.0 * lag], atol=1e-5)
    assert_allclose(found["command_moves"], [*2.0 * move] * 3, atol=1e-5)
    assert_allclose(found["gimbal_moves"], [*10.0 * (move - lag)] * 3, atol=1e-5)
    distance = np.hypot(4.0, 0.5 if kind in TRACKING else 0.5099)
    assert_allclose(found["distance"], 0.5 * (distance - 3.0), atol=1e-4)
    if kind in TRACKING:
        assert_allclose(found["ages"], [0.9, 0.2], rtol=1e-5)
        assert_allclose(found["clock"], [0.1, np.tanh(0.4)], rtol=1e-5)
        assert_allclose([*found["bearings"], *found["histories"]], 0.0, atol=1e-3)


def test_trackers_know_the_speed_and_which_model_fits():
    for speed in (0.0, 1.0):
        places = [[3.0, 0.02 * step * speed - 0.5, 0.1] for step in range(40)]
        seen = [seen_at(place, elapsed=0.02 * (step > 0), age=0.0) for step, place in enumerate(places)]
        for kind, name, scale in (("tracked", "across", 5.0), ("multimodel", "speeds", 5.0)):
            observer = make_observer(facts(kind))
            found = by_block(observer, observer.observe(observer.view(remembered(observer, seen))))
            assert found[name][0] == pytest.approx(scale * speed, rel=0.05, abs=0.05)
        still, onward = found["models"][:2]  # the last: of multimodel
        assert (still > 0.5, onward > 0.5) == (speed == 0.0, speed == 1.0)


def test_models_judge_by_what_is_seen_across_the_line_of_sight():
    observer, found = make_observer(facts("multimodel")), {}
    for depth in (0.0, 1.0):  # to and fro in depth every 0.3 s, while it drives to the left
        side = [0.02 * depth * min(step % 30, 30 - step % 30) for step in range(60)]
        places = [[3.0 + side[step], 0.003 * (step - 30), 0.1] for step in range(60)]
        seen = [seen_at(place, age=0.0) for place in places]
        memory = remembered(observer, seen)
        found[depth] = by_block(observer, observer.observe(observer.view(memory)))["models"][:3], memory.tracks
    assert_allclose(found[1.0][0], found[0.0][0], atol=0.2)
    across, along = found[1.0][1].innovation
    assert along > 10.0 * across


def test_of_several_slots_the_one_nearest_to_the_prediction_counts():
    observer = make_observer(facts("multimodel"))
    one, two = (observed(observer, sequence((4,), slots=slots)) for slots in (1, 2))
    assert_allclose(two[-1][0], one[-1][0], atol=1e-4)


@pytest.mark.parametrize("kind", TRACKING)
def test_commands_keep_the_largest_move_brake_in_time_and_arrive(kind):
    observer, first = make_observer(facts(kind)), seen_at([3.0, 0.4, 0.1], elapsed=0.0)
    free, memory, commands = observers(kind)[1], observer.begin(first), [first.command] * 2
    for step in range(120):
        action = np.array([4.0, 10.0], np.float32) * (-1.0) ** (step // 30)
        now = first._replace(elapsed=np.float32(0.02 * (step > 0)), command=commands[-1])
        memory = observer.remember(memory, now)
        commands.append(observer.decode(view := observer.view(memory), action).angle)
        move, before = np.abs(commands[-1] - commands[-2]), np.abs(commands[-2] - commands[-3])
        assert np.all(move <= observer.largest_move * (1.0 + 1e-5))
        if step % 30:
            assert np.all(before - move <= observer.braking * 1.001 + 1e-6)
        if step % 30 == 29:
            assert_allclose(commands[-1], free.decode(view, action).angle, atol=1e-6)
    assert np.any(np.abs(np.diff(commands, axis=0)) >= 0.999 * observer.largest_move)


def test_while_nothing_is_seen_all_numbers_are_finite_and_afterwards_the_target_is_found():
    for kind in OBSERVATIONS:
        observer, free = observers(kind)
        seen = [seen_at([3.0, 0.5, 0.1], (0.1, -0.2), elapsed=0.02 * (step > 0), age=0.0) for step in range(80)]
        dark = [each._replace(frames=map_arrays(np.zeros_like, each.frames)) for each in seen[:60]]
        assert np.isfinite([each for each, _ in observed(observer, dark)]).all()
        commands = [command for _, command in observed(free, [*dark, *seen[60:]], 0.0)]
        assert_allclose(commands[-1][1], np.arctan2(0.5, 3.0), atol=1e-3)


@pytest.mark.parametrize("kind", OBSERVATIONS)
def test_a_detection_far_away_or_straight_above_leaves_all_numbers_finite(kind):
    observer = make_observer(facts(kind))
    memory = observer.begin(seen_at([3.0, 0.0, 0.1]))
    for place in ([200.0, 10.0, 0.0], [0.0, 0.0, 3.0], [0.0, 0.0, 0.0], [3.0, 0.0, 0.1]):
        memory = observer.remember(memory, seen_at(place, elapsed=0.02))
        view = observer.view(memory)
        assert np.isfinite(observer.decode(view, np.zeros((1, 2))).angle).all()
        assert all(np.isfinite(each).all() for each in leaves((observer.observe(view), memory)))


def test_a_window_is_the_exact_step_of_its_equation_and_keeps_the_last_second():
    order, length, period = 12, 1.0, 0.02
    window, i = legendre_window(order, length, period), np.arange(order)
    rows = (2 * i + 1)[:, None] * np.where(i[:, None] < i, -1.0, (-1.0) ** (i[:, None] - i + 1.0))
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[:order, -1] = rows, (2 * i + 1) * (-1.0) ** i
    found = np.hstack([window.transition, window.input[:, None]])
    assert_allclose(found, expm(whole * period / length)[:-1], atol=1e-12)
    times = period * np.arange(101)
    kept = constant_history(window, np.sin(3.0 * times[0] - 6.0))
    for each in times:
        kept = with_sample(window, kept, np.sin(3.0 * each - 6.0))
    back = np.linspace(0.05, 0.95, 10)
    assert_allclose(legval(2.0 * back - 1.0, kept), np.sin(3.0 * (times[-1] - back) - 6.0), atol=0.05)


def test_a_block_of_a_users_own_is_added_and_its_faults_are_named(tmp_path, monkeypatch, refused):
    (tmp_path / "mine.py").write_text(
        "def clock(observer, view): return view.memory.clock[..., None]\n"
        "def flat(observer, view): return view.memory.clock\n"
        "def lost(observer, view): return view.no_such[..., None]\n"
    )
    monkeypatch.chdir(tmp_path)
    made = observer_facts(("history", "./mine.py:clock"), PAPER, TASK)
    assert make_observer(made, ("./mine.py:clock",)).layout()[-1] == ("clock", 1)
    refused("history has 1 blocks of a user's own, got 0; give ./mine.py:clock", make_observer, made)
    refused("got 1; leave them out", make_observer, observer_facts("history", PAPER, TASK), ("./mine.py:clock",))
    refused("returns float32 of shape .2,. for a batch", make_observer(made, ("./mine.py:flat",)).layout)
    refused("mine.py:lost: line 3: AttributeError", make_observer(made, ("./mine.py:lost",)).layout)


@pytest.fixture
def policy():
    rng, kind = np.random.default_rng(0), "multimodel"
    widths = (SIZES[kind], 8, 2)
    pairs = itertools.pairwise(widths)
    layers = tuple(Layer(rng.normal(0.0, 0.3, pair), rng.normal(0.0, 0.1, pair[1])) for pair in pairs)
    normaliser = Normaliser(rng.normal(0.0, 0.1, widths[0]), rng.uniform(0.5, 2.0, widths[0]), np.zeros(()))
    about = PolicyFacts(observer=facts(kind), task=TASK, robot=PAPER.record_digests(), seed=3)
    return Policy(make_observer(facts(kind)), *single_precision((normaliser, layers)), facts=about)


DECIDE = """
import numpy as np
from archerfish.protocols import seen_ahead
from archerfish.controllers.policy.policy import Policy
policy, seen = Policy.load(PATH), seen_ahead(2)
print(policy.step(policy.reset(seen), seen)[1].angle.tolist())
"""


def test_a_policy_is_read_back_to_the_bit_and_decides_without_jax_and_scipy(tmp_path, policy, run_python):
    policy.save(path := tmp_path / "policy.safetensors")
    again = Policy.load(tmp_path)
    for ours, theirs in zip(leaves(again), leaves(policy), strict=True):
        assert_array_equal(ours, theirs)
    assert (again.facts.seed, again.facts.task, again.facts.observer.frames) == (3, TASK, 4)
    again.save(tmp_path / "again.safetensors")
    assert (tmp_path / "again.safetensors").read_bytes() == path.read_bytes()
    printed = run_python(DECIDE.replace("PATH", repr(str(path))), blocked=("jax", "scipy", "matplotlib", "gymnasium"))
    assert np.isfinite(json.loads(printed)).all()


def parts_of(content):
    """The header of a policy's file, the SHA-256 of its arrays, its facts, and the rest."""
    size = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + size])
    digest, _, text = header["__metadata__"]["archerfish"].partition(" ")
    return header, digest, text, content[8 + size :]


def with_facts(content, text):
    """A policy's file with other facts."""
    header, digest, _, rest = parts_of(content)
    header["__metadata__"]["archerfish"] = f"{digest} {text}"
    made = json.dumps(header).encode()
    return struct.pack("<Q", len(made)) + made + rest


FACTS = [
    ("observer.frames", 10**9, "field observer.frames: expected int <= 64"),
    ("observer.frames", -5, "field observer.frames: expected int >= 2"),
    ("observer.frames", 5, "array mean: expected float32 .124,., got float32 .120,."),
    ("observer.period_s", 0.0, "field observer.period_s: expected float >= 0.0001"),
    ("observer.braking", [1.0], "field observer.braking: expected array of length 2"),
    ("observer.tracker", None, "expected one of paper"),
    ("observer.tracker", {**plain(facts("tracked").tracker), "along": 1e-5}, "tracker.along: expected float >= 0.0001"),
    ("observer.speed", 0.1, "field observer.speed: expected float >= 2.0"),
    ("observer.observation", ["sextant"], "observation: expected one of paper"),
    ("observer.observation", ["multimodel", "./mine.py:Mine"], "has blocks of a user's own"),
    ("observer.period_s", 1, ""),
    ("remake", "archerfish train", ""),
    ("nobody", 1, "unknown field"),
    ("seed", "1", "field seed: expected int, got"),
]


@pytest.mark.parametrize(("name", "value", "complaint"), FACTS)
def test_bad_facts_are_named(tmp_path, policy, refused, name, value, complaint):
    policy.save(path := tmp_path / "policy.safetensors")
    content = path.read_bytes()
    made = json.loads(parts_of(content)[2])
    part, _, field = name.rpartition(".")
    (made[part] if part else made)[field] = value
    path.write_bytes(with_facts(content, json.dumps(made)))
    if complaint:
        refused(f"^{path}: .*{complaint}", Policy.load, path)
    else:
        assert Policy.load(path).facts.seed == 3


def test_mutated_facts_are_refused_or_give_a_policy_that_decides(tmp_path, policy, mutated):
    policy.save(path := tmp_path / "policy.safetensors")
    content, read = path.read_bytes(), lambda: Policy.load(path)
    path.write_text(parts_of(content)[2])
    seen = [seen_at([3.0, 0.01 * step, 0.1], elapsed=0.02 * (step > 0)) for step in range(5)]
    for found in mutated(path, read, 150, convert=lambda text: with_facts(content, text.decode(errors="replace"))):
        memory = found.reset(seen[0])
        for each in seen:
            memory, command = found.step(memory, each)
            assert np.isfinite(command.angle).all(), found.facts


def test_bad_arrays_and_damaged_files_are_named(tmp_path, policy, refused):
    path = tmp_path / "policy.safetensors"
    negative = policy.normaliser._replace(variance=-policy.normaliser.variance)
    lost = (Layer(policy.actor[0].weight * np.float32(np.nan), policy.actor[0].bias), policy.actor[1])
    huge, double = map_arrays(lambda each: each * np.float32(1e9), policy.actor), map_arrays(np.float64, policy.actor)
    cases = ((negative, policy.actor, "variance: expected numbers ≥ 0"),
             (policy.normaliser, lost, "weight.0: .* within"),
             (policy.normaliser, huge, "weight.0: .* within"),
             (policy.normaliser, double, "expected float32 .120, 8., got float64"),
             (policy.normaliser, policy.actor[:1], "weight.0: expected float32 .120, 2."))  # fmt: skip
    for normaliser, actor, complaint in cases:
        Policy(policy.observer, normaliser, actor, facts=policy.facts).save(path)
        refused(f"^{path}: .*{complaint}", Policy.load, path)
    policy.save(path)
    content = path.read_bytes()
    for place in (0, 100, len(content) // 2, len(content) - 1):
        path.write_bytes(content[:place] + bytes([content[place] ^ 8]) + content[place + 1 :])
        refused(f"^{path}: .*(damaged|is no .safetensors file|SafetensorError|is not JSON)", Policy.load, path)
        path.write_bytes(content[:place])
        refused(f"^{path}: ", Policy.load, path)
    refused("there is no such file", Policy.load, tmp_path / "none.safetensors")
    refused("a policy without facts", Policy(policy.observer, policy.normaliser, policy.actor).save, path)
