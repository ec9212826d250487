"""What policies see and command, and their files."""

import itertools
import json
import struct
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import legval
from numpy.testing import assert_allclose, assert_array_equal
from scipy.linalg import expm

from archerfish2.arrays import leaves, map_arrays, single_precision
from archerfish2.controllers.blocks import KINDS
from archerfish2.controllers.network import Layer, Normaliser
from archerfish2.controllers.observation import make_observer, observer_facts
from archerfish2.controllers.policy import Policy, PolicyFacts
from archerfish2.protocols import Barrel, Base, Frames, GimbalFeedback, Seen
from archerfish2.robot import Robot
from archerfish2.task import Task
from archerfish2.tracking.legendre_memory import constant_history, legendre_window, with_sample

PAPER = Robot.paper()
SENSING = Robot.load(Path(__file__).parents[1] / "infantry").replace(muzzle=PAPER.muzzle)  # without offsets
TASK, SIZES = Task.load("paper"), {"paper": 6, "history": 35, "tracked": 55, "multimodel": 118}
TRACKING = ("tracked", "multimodel")


def facts(kind):
    return observer_facts(kind, SENSING if kind == "tracked" else PAPER, TASK)


def sequence(batch, steps=8, mirror=1.0, shift=(0.0, 0.0, 0.0), turns=0, frames=1, slots=1):
    """Decisions at which a target drives past; in a mirror, elsewhere, or with a gimbal that has turned around."""
    rng, zero = np.random.default_rng(3), np.zeros(batch)
    side, shift, found = np.array([1.0, mirror]), np.array(shift), []
    speed, begin = rng.uniform(-1.0, 1.0, batch), rng.uniform(-0.3, 0.3, batch)
    for step in range(steps):
        angle, command = (rng.normal(0.0, 0.05, (*batch, 2)) * side for _ in range(2))
        age = 0.03 - 0.005 * np.arange(frames) + np.zeros((*batch, frames))
        y = mirror * (begin[..., None] + speed[..., None] * (0.02 * step - age))
        place = np.stack([3.0 + 0.0 * y, y, 0.1 + 0.0 * y], axis=-1)[..., None, :] + shift
        place = np.repeat(place, slots, axis=-2) + 0.5 * np.arange(slots)[:, None] * side[1] * [0.0, 1.0, 0.0]
        shown = np.full((*batch, frames, slots), step != 3)
        turned = np.array([0.0, 2.0 * np.pi * turns])
        base = Base(np.broadcast_to(shift, (*batch, 3)), np.zeros((*batch, 3)), zero, zero)
        gimbal = GimbalFeedback(angle + turned, 0.0 * angle, zero + 0.002)
        seen = Frames(
            np.ones((*batch, frames), bool), age, shown, np.where(shown[..., None], place, 0.0), 0.0 * y[..., None]
        )
        found.append(Seen(zero + 0.02 * (step > 0), gimbal, command + turned, seen, base, Barrel(zero + 18.0, zero)))
    return single_precision(tuple(found))


def observed(observer, seen, action=0.5):
    """Observations and commands, decision by decision."""
    memory, found = observer.begin(seen[0]), []
    for each in seen:
        memory = observer.remember(memory, each)
        view = observer.view(memory)
        found.append((observer.observe(view), observer.decode(view, action + 0.0 * view.aim).angle))
    return tuple(found)


LARGE = [(kind, batch) for kind in TRACKING for batch in ((), (3,))]  # to compile; (2, 3) is in `make test`
BOTH = [(kind, batch) for kind in KINDS for batch in ((), (3,), (2, 3))]


@pytest.mark.parametrize(
    ("kind", "batch"), [pytest.param(*each, marks=[pytest.mark.slow] * (each in LARGE)) for each in BOTH]
)
def test_numpy_and_jax_observe_and_command_alike(kind, batch, agree):
    agree(observed, make_observer(facts(kind)), sequence(batch, 2, frames=2, slots=2), rtol=1e-4, atol=2e-4)


@pytest.mark.parametrize("kind", KINDS)
def test_observations_have_their_size_mirror_images_and_depend_on_relative_places(kind):
    observer = make_observer(facts(kind))
    assert sum(size for _, size in observer.layout()) == SIZES[kind]
    plain, mirrored, elsewhere, around = (
        observed(observer, sequence((4,), **each), 0.0)
        for each in ({}, {"mirror": -1.0}, {"shift": (0.5, -0.25, 0.125)}, {"turns": -1})
    )
    for (numbers, angle), (image, opposite), (moved, same), (_, turned) in zip(
        plain, mirrored, elsewhere, around, strict=True
    ):
        assert_allclose(np.abs(image), np.abs(numbers), atol=2e-3)
        assert_allclose(opposite, angle * [1.0, -1.0], atol=1e-5)
        assert_allclose(moved, numbers, atol=2e-3)
        assert_allclose(same, angle, atol=1e-5)
        if kind != "paper":  # whose last angles are not relative to anything
            assert_allclose(turned - angle, np.tile([0.0, -2.0 * np.pi], (4, 1)), atol=1e-5)


def test_of_several_slots_the_one_nearest_to_the_prediction_counts():
    observer = make_observer(facts("multimodel"))
    one, two = (observed(observer, sequence((4,), slots=slots)) for slots in (1, 2))
    assert_allclose(two[-1][0], one[-1][0], atol=1e-4)


@pytest.mark.parametrize("kind", TRACKING)
def test_commands_keep_the_largest_move_and_can_stop(kind):
    observer, (first, *_) = make_observer(facts(kind)), sequence((3,))
    memory, commands, rng = observer.begin(first), [first.command] * 2, np.random.default_rng(1)
    for step in range(60):
        seen = first._replace(elapsed=first.elapsed + np.float32(0.02 * (step > 0)), command=commands[-1])
        memory = observer.remember(memory, seen)
        action = rng.choice([-20.0, 20.0], (3, 2)).astype(np.float32) if step % 15 == 0 else action  # noqa: F821
        commands.append(observer.decode(observer.view(memory), action).angle)
    moves = np.diff(np.float64(commands), axis=0)
    assert np.all(np.abs(moves) <= observer.largest_move * (1.0 + 1e-5))
    assert np.abs(moves).max() == pytest.approx(observer.largest_move.max(), rel=1e-3)


def test_a_window_is_the_exact_step_of_its_equation_and_keeps_the_last_second():
    order, length, period = 12, 1.0, 0.02
    window, i = legendre_window(order, length, period), np.arange(order)
    rows = (2 * i + 1)[:, None] * np.where(i[:, None] < i, -1.0, (-1.0) ** (i[:, None] - i + 1.0))
    whole = np.zeros((order + 1, order + 1))
    whole[:order, :order], whole[:order, -1] = rows, (2 * i + 1) * (-1.0) ** i
    assert_allclose(
        np.hstack([window.transition, window.input[:, None]]), expm(whole * period / length)[:-1], atol=1e-12
    )
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
    refused("expected .* then the blocks ./mine.py:clock; got history and 0 blocks", make_observer, made)
    refused("mine.py:flat: returns float32 of shape .2,. for a batch", make_observer, made, ("./mine.py:flat",))
    refused("mine.py:lost: line 3: AttributeError", make_observer, made, ("./mine.py:lost",))


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
from archerfish2.controllers.observation import _nothing_seen
from archerfish2.controllers.policy import Policy
policy, seen = Policy.load(PATH), _nothing_seen()
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


def changed(content, change):
    """A policy's file with changed facts."""
    size = struct.unpack("<Q", content[:8])[0]
    header = json.loads(content[8 : 8 + size])
    digest, _, old = header["__metadata__"]["archerfish"].partition(" ")
    made = json.loads(old)
    part, _, name = change[0].rpartition(".")
    (made[part] if part else made)[name] = change[1]
    header["__metadata__"]["archerfish"] = f"{digest} {json.dumps(made)}"
    text = json.dumps(header).encode()
    return struct.pack("<Q", len(text)) + text + content[8 + size :]


FACTS = [
    ("observer.frames", 10**9, "field observer.frames: expected int <= 64"),
    ("observer.frames", -5, "field observer.frames: expected int >= 2"),
    ("observer.frames", 5, "array mean: expected float32 .122,., got float32 .118,."),
    ("observer.period_s", 0.0, "field observer.period_s: expected float >= 0.0001"),
    ("observer.braking", [1.0], "field observer.braking: expected array of length 2"),
    ("observer.tracker", None, "expected one of paper"),
    ("observer.observation", ["sextant"], "observation: expected one of paper"),
    ("observer.observation", ["multimodel", "./mine.py:Mine"], "has blocks of a user's own"),
    ("nobody", 1, "unknown field"),
    ("seed", "1", "field seed: expected int, got"),
]


@pytest.mark.parametrize(("name", "value", "complaint"), FACTS)
def test_bad_facts_are_named(tmp_path, policy, refused, name, value, complaint):
    policy.save(path := tmp_path / "policy.safetensors")
    path.write_bytes(changed(path.read_bytes(), (name, value)))
    refused(f"^{path}: .*{complaint}", Policy.load, path)


def test_a_whole_number_is_a_period(tmp_path, policy):
    policy.save(path := tmp_path / "policy.safetensors")
    path.write_bytes(changed(path.read_bytes(), ("observer.period_s", 1)))
    assert Policy.load(path).facts.observer.period_s == 1.0


def test_bad_arrays_and_damaged_files_are_named(tmp_path, policy, refused):
    path = tmp_path / "policy.safetensors"
    negative = policy.normaliser._replace(variance=-policy.normaliser.variance)
    lost = (Layer(policy.actor[0].weight * np.float32(np.nan), policy.actor[0].bias), policy.actor[1])
    double = map_arrays(np.float64, policy.actor)
    cases = ((negative, policy.actor, "variance: expected numbers ≥ 0"),
             (policy.normaliser, lost, "weight.0: .* within"),
             (policy.normaliser, double, "expected float32 .118, 8., got float64"),
             (policy.normaliser, policy.actor[:1], "weight.0: expected float32 .118, 2."))  # fmt: skip
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
