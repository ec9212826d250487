"""Printed decisions against NumPy's, in C and ONNX; the programs of the page; what can't be exported."""

import ctypes
import functools
import itertools
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose

import archerfish as af
from archerfish.arrays import fold, leaves, map_arrays, namespace, repeat
from archerfish.cli.main import main
from archerfish.codegen import check, library, trace
from archerfish.codegen.c99 import print_c
from archerfish.codegen.decision import ARMING, GATE_SIZE, Decision, Gated, example_decisions, trace_decision
from archerfish.codegen.library import c_decision
from archerfish.codegen.onnx import print_onnx
from archerfish.codegen.trace import Trace, scalars_of, schedule
from archerfish.controllers.policy.network import Layer, Normaliser
from archerfish.controllers.policy.observation import make_observer, observer_facts
from archerfish.controllers.policy.policy import PolicyFacts
from archerfish.controllers.registry import make_controller
from archerfish.protocols import aim
from archerfish.records.json_files import plain
from archerfish.safety.gate import GateVerdict, Mode, Reason
from archerfish.safety.rules import gate_rules
from archerfish.studies.export import export

PAPER, INFANTRY = af.Robot.paper(), af.Robot.load(Path(__file__).parents[1] / "infantry")
TASK = af.Task.load("paper")
LOOP = Path(__file__).parents[2] / "examples" / "robot_loop.cpp"
PAGE = (Path(__file__).parents[2] / "docs" / "export.md").read_text()
WARNINGS = ("-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror")
STRICT = ("-std=c99", *WARNINGS, "-O0", "-shared", "-fPIC")
POLICIES = {"paper": PAPER, "history": PAPER, "tracked": INFANTRY, "multimodel": INFANTRY}
CONTROLLERS = ("kalman", "kalman-lq", "imm-lq", "no-lead")
NAMES = (*POLICIES, *CONTROLLERS)
gcc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


def policy(kind, robot):
    """A policy with a network that nobody trained."""
    facts, rng = observer_facts(kind, robot, TASK), np.random.default_rng(4)
    observer = make_observer(facts)
    widths = [sum(size for _, size in observer.layout()), 24, 16, 2]
    layers = [rng.normal(0.0, 0.3, pair).astype(np.float32) for pair in itertools.pairwise(widths)]
    actor = tuple(Layer(each, rng.normal(0.0, 0.1, each.shape[1]).astype(np.float32)) for each in layers)
    mean, variance = rng.normal(0.0, 0.1, (2, widths[0])).astype(np.float32)
    normaliser = Normaliser(mean, np.abs(variance) + 1.0, np.asarray(0.0, np.float32))
    return af.Policy(observer, normaliser, actor, PolicyFacts(observer=facts, task=TASK, robot=robot.record_digests()))


def made(name):
    """A controller, gated, and its robot."""
    robot = POLICIES.get(name, INFANTRY)
    controller = policy(name, robot) if name in POLICIES else make_controller(name, robot, TASK)
    return Gated(controller, gate_rules(robot, TASK)), controller, robot


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Export a controller once; return its C file and, compiled with all warnings as errors, its library."""
    folder, kept = tmp_path_factory.mktemp("c"), {}

    def get(name):
        if name not in kept:
            _, controller, robot = made(name)
            path = folder / f"{name.replace('-', '_')}.c"
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(library, "FLAGS", STRICT)
                patch.setattr("archerfish.studies.export.compiled", lambda *_: None)  # compiled once, and kept
                export(controller if name in POLICIES else name, path, robot, TASK, tuning="start")
                kept[name] = path, c_decision(path)
        return kept[name]

    return get


@gcc
@pytest.mark.parametrize("name", NAMES)
def test_c_decides_as_numpy_with_a_memory_of_its_own(exported, name):
    path, library = exported(name)
    assert check.compared(library.decide, made(name)[0])[check.DIFFERENCE] < 5e-5
    missing = subprocess.check_output(["nm", "-u", path.with_suffix(".so")], text=True)
    names = {word.split("@")[0] for word in missing.split() if len(word) > 1}
    names = {each for each in names if not each.startswith("_")}
    assert names <= {f"{each}f" for each in (*trace._FUNCTIONS.split(), "atan2", "floor", "rint")}


def openvino_decision(model):
    """Return the decision of a model in OpenVINO, which knows neither functions of a model's own nor what is new."""
    openvino = pytest.importorskip("openvino", reason="openvino is not installed")
    core, options = openvino.Core(), {"INFERENCE_PRECISION_HINT": "f32"}
    compiled = core.compile_model(core.read_model(model), "CPU", options)
    wanted = {each.any_name: each.shape for each in compiled.inputs}
    kept = {"memory": np.zeros(wanted["memory"], np.float32), "first": np.array([True])}

    def decide(given):
        known = {name: np.atleast_1d(value) for name, value in given.items()} | kept
        found = compiled({name: known[name] for name in wanted})
        command, fire, codes, memory = (np.array(found[each]) for each in compiled.outputs)
        kept.update(memory=memory, first=np.array([False]))
        return GateVerdict(command, fire[0], *codes), 0

    return decide


@pytest.mark.parametrize(
    ("name", "decision"),
    [
        *((name, check.onnx_decision) for name in (*POLICIES, "kalman", "kalman-lq")),
        pytest.param("imm-lq", check.onnx_decision, marks=pytest.mark.slow),
        *(
            pytest.param(name, openvino_decision, marks=pytest.mark.slow)
            for name in ("multimodel", "kalman", "kalman-lq")
        ),
    ],
)
def test_onnx_decides_as_numpy_with_a_memory_of_its_own(name, decision):
    onnx = pytest.importorskip("onnx")
    gated, _, _ = made(name)
    model = onnx.load_from_string(written := print_onnx(trace_decision(gated), {}))
    assert (model.ir_version, [(each.domain, each.version) for each in model.opset_import]) == (8, [("", 17)])
    assert not model.functions
    decide = decision(written) or pytest.skip("onnxruntime is not installed")
    for given, verdict in example_decisions(gated, ARMING + 5, seed=3):
        found, _ = decide(given)
        assert check.verdict_difference(found, verdict) < 2e-6  # some roundings of float32 at angles of up to 1 rad


EDGES = np.float32([0.0, -0.0, 1e-42, -1e-42, 1.0, -3.0, 0.02, 1e3, -1e30, 1e30, 3e38, np.nan, np.inf, -np.inf])


def hostile_decisions(gated, n, count):
    """Yield inputs of n sequences, of which many are absurd; they are armed at first, and again in the middle."""
    rng = np.random.default_rng(8)
    usual, off = usual_decisions(gated)
    share = np.where(rng.random(n) < 0.5, 0.002, 0.05)
    for at in range(count):
        if at % (count // 2) < 30:
            yield {name: np.array([value] * n) for name, value in off.items()}
            continue
        given = {}
        for name, value in usual.items():
            shape = (n, *value.shape)
            noise, wrong = rng.normal(0.0, 1e-3, shape), share > rng.random(shape).T
            drawn = np.where(rng.random(shape) < 0.5, rng.choice(EDGES, shape), rng.normal(0.0, 3.0, shape))
            given[name] = np.where(wrong.T, drawn, value + noise).astype(np.float32)
        yield given | {
            "found": rng.random(n) < 0.8,
            "switch_on": rng.random(n) < 0.999,
            "distrusted": rng.random(n) < 0.001,
        }


SLOW = [pytest.param(name, 100, marks=pytest.mark.slow) for name in NAMES]


@gcc
@pytest.mark.parametrize(("name", "n"), [("kalman", 50), ("multimodel", 10), ("kalman-lq", 10), *SLOW])
def test_with_any_input_c_decides_as_numpy_within_the_limits(exported, name, n):
    gated, (_, library), modes, differences = made(name)[0], exported(name), set(), []
    low, high = (np.float32(each) for each in (gated.rules.limits.low, gated.rules.limits.high))
    state = map_arrays(lambda each: np.array([each] * n), gated.reset())
    library.reset()
    memories = np.array([library.memory] * n)
    for at, inputs in enumerate(hostile_decisions(gated, n, 200)):
        if at and name != "kalman":  # random weights and choices between hypotheses amplify roundings of earlier ones
            memories[:, :-3] = np.concatenate([each.reshape(n, -1) for each in leaves(state)], axis=1)
        with np.errstate(all="ignore"):  # what hostile input makes of a tracker, no command has
            state, expected = gated.step(state, inputs)
        for k in range(n):
            library.memory[:] = memories[k]
            given = {field: value[k] for field, value in inputs.items()}
            verdict, status = library.decide(given)
            memories[k] = library.memory
            turned = [0.0, state.gate.base_yaw[k]]
            rounding = 1e-5 + 1e-7 * abs(turned[1])
            assert np.all((verdict.angle >= low + turned - rounding) & (verdict.angle <= high + turned + rounding))
            needed = np.concatenate([np.atleast_1d(given[each]) for each in ("elapsed", "angle", "rate", "base_yaw")])
            assert status == 1 or np.all(np.abs(needed) <= 1e3)
            assert not (verdict.fire and (status or verdict.mode != Mode.ARMED))
            differences.append(check.verdict_difference(verdict, GateVerdict(*(each[k] for each in expected))))
            modes.add(verdict.mode)
    assert modes == {*Mode}
    assert max(differences) <= (0.01 if name == "imm-lq" else 5e-5)
    assert np.mean(np.array(differences) > 5e-5) <= 1e-3  # two hypotheses may be almost equal


def usual_decisions(gated):
    """The last of some usual inputs, with the switch on and off."""
    given = [*example_decisions(gated, ARMING + 1)][-1][0] | {"base_yaw": np.float32(0.0)}
    return given, given | {"switch_on": np.array(False)}


@gcc
def test_a_library_is_armed_once_reset_and_stays_armed_with_a_new_target(exported):
    gated, (path, library) = made("no-lead")[0], exported("no-lead")
    given, off = usual_decisions(gated)
    name, loaded = "no_lead", ctypes.CDLL(path.with_suffix(".so"))
    should_fire, words = loaded[f"{name}_should_fire"], loaded[f"{name}_reason_text"]
    words.restype = ctypes.c_char_p
    assert [words(each).decode() for each in (*Reason, -1, len(Reason))] == [*(each.text for each in Reason), "", ""]
    for fill in (0, 1, -1):  # memory that was not reset
        library.memory.view(np.int32)[:] = fill
        assert [library.decide(off)[1] for _ in range(60)] == [1] * 60
        assert library.decide(given)[0].mode == Mode.DISARMED
    library.reset()
    verdict, status = library.decide(off | {"elapsed": np.float32(np.nan)})  # the first one, of any time
    assert (status, verdict.mode, verdict.cause) == (0, Mode.DISARMED, Reason.STARTING)
    assert verdict.angle.tolist() == off["angle"].tolist()
    assert [library.decide(off)[1] for _ in range(24)] == [0] * 24

    def shoots():
        return should_fire(*library._arguments[:2])

    unseen = given | {"found": np.array(False)}
    library.new_target()
    verdicts = [library.decide(unseen)[0] for _ in range(15)]
    assert [(each.mode, each.reason, *each.angle) for each in verdicts] == [(1, 5, *given["angle"])] * 15
    far = given | {"plate": np.float32([3.0, 0.05, 0.0])}
    assert (library.decide(far)[0].reason, shoots()) == (Reason.NONE, 1)  # 0.3 s after it was armed
    assert library.decide(far | {"distrusted": np.array(True)})[0][2:] == (Mode.HOLD, Reason.HOLD, Reason.IMPLAUSIBLE)
    assert [library.decide(far)[0].mode for _ in range(3)] == [Mode.HOLD, Mode.HOLD, Mode.ARMED]  # more than 50 ms
    before = library.gate
    ahead, _ = library.decide(far | {"angle": given["angle"] + np.float32(0.3)})
    assert (ahead.fire, shoots()) == (1, 0)  # the gimbal is not there yet
    library.gate = before
    assert str(library.gate) == str(before)
    lost = [library.decide(unseen | {"elapsed": np.float32(0.04)})[0].reason for _ in range(7)]
    assert lost == [0] * 5 + [Reason.PLATE_UNSEEN] * 2  # 0.25 s after the exposure
    library.decide(given)
    library.new_target()
    assert library.decide(unseen)[0][2:] == (Mode.ARMED, Reason.PLATE_UNSEEN, Reason.NONE)
    for wrong in (-1e-3, 20.1, np.nan):  # a clock that was set: it holds, and the controller begins again
        library.decide(given)
        assert library.decide(unseen | {"elapsed": np.float32(wrong)})[1] == 1
        assert library.memory[GATE_SIZE] == 1e6


@gcc
def test_absurd_detections_are_unseen_and_leave_the_tracker_as_it_is(exported):
    gated, (_, library) = made("kalman")[0], exported("kalman")
    given, off = usual_decisions(gated)
    absurd = [("plate", [1e38, 0, 0]), ("plate", [np.nan, 0, 0]), ("plate", [0.05, 0.05, 0]), ("plate", [0, 0, 0])]
    absurd += [("frame_age", age) for age in (-1e-3, 1.1, np.nan, 1e9)]
    expected = None
    for name, value in [("found", False), *absurd]:
        library.reset()
        for each in [off] * 26 + [given] * 9:
            library.decide(each)
        verdicts = [library.decide(given | {name: np.asarray(value)})[0] for _ in range(20)]
        assert [each.reason for each in verdicts][-1] == Reason.PLATE_UNSEEN
        assert {each.mode for each in verdicts} == {Mode.ARMED}
        expected = expected or str(verdicts)
        assert str(verdicts) == expected
    library.reset()
    unseen = {"found": np.array(False)}
    blind = given | {"rate": np.float32([np.nan, 0.0])}  # a plate that the controller can't take
    inputs = [off | unseen] * 30 + [given | unseen] * 2 + [blind] + [given | unseen] * 6
    reasons = [library.decide(each)[0].reason for each in inputs]
    assert reasons[-3:] == [Reason.PLATE_UNSEEN] * 3


@gcc
@pytest.mark.skipif(shutil.which("c++") is None, reason="there is no C++ compiler")
def test_the_example_in_cpp_hits_and_is_not_linked_with_the_header_of_another_export(tmp_path, monkeypatch):
    monkeypatch.setattr("archerfish.studies.export.compiled", lambda *_: None)
    export("kalman-lq", tmp_path / "policy.c", PAPER, "any", tuning="start")
    shutil.copy(LOOP, tmp_path)
    subprocess.run(["cc", "-std=c99", "-O1", "-c", "policy.c"], cwd=tmp_path, check=True)
    words = ["c++", "-std=c++17", "-O1", *WARNINGS, LOOP.name, "policy.o", "-lm", "-o", "main"]
    shots, _, hits, _ = run(tmp_path, words).split()
    assert int(shots) > 900  # of the 1000 decisions
    assert int(hits) > 0.85 * int(shots)
    (function,) = re.findall(r"```cpp\n(static .*?)```", PAGE, re.DOTALL)
    assert function in LOOP.read_text()
    header = tmp_path / "policy.h"
    header.write_text(re.sub(r"(policy_decide_|policy_version 0x)[0-9a-f]{8}", r"\g<1>0a1b2c3d", header.read_text()))
    failed = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True)
    assert "undefined reference to `policy_decide_0a1b2c3d'" in failed.stderr
    failed = subprocess.run(["cc", "-c", "policy.c"], cwd=tmp_path, capture_output=True, text=True)
    assert "policy.h is that of another export: copy both files again" in failed.stderr


@gcc
def test_a_self_test_finds_errors(exported, tmp_path, monkeypatch, refused):
    monkeypatch.setattr(library, "FLAGS", STRICT)
    path, _ = exported("kalman")
    (tmp_path / "kalman.h").write_text(path.with_suffix(".h").read_text())
    text = path.read_text()
    rows = text[text.index("expected[") :].split("\n")
    row = rows[ARMING + 3]
    right = row.strip(" {},").split(", ")
    wrong = [f"{float(right[0][:-1]) + 3e-4}f", right[1], *(f"{float(each[:-1]) + 1}f" for each in right[2:])]
    for at in (0, 2, 3, 4, 5):
        values = ", ".join([*right[:at], wrong[at], *right[at + 1 :]])
        (tmp_path / "kalman.c").write_text(text.replace(row, f"    {{{values}}},", 1))
        refused(f"decision {ARMING + 3} of its self-test is not that of NumPy", c_decision, tmp_path / "kalman.c")


def run(folder, words):
    subprocess.run(words, cwd=folder, check=True)
    return subprocess.check_output([folder / "main"], text=True)


@gcc
def test_the_programs_of_the_page_run_and_two_files_go_into_one(exported, tmp_path, monkeypatch):
    path, *_ = exported("history")
    for end in (".c", ".h"):
        text = path.with_suffix(end).read_text()
        (tmp_path / f"policy{end}").write_text(text.replace("history", "policy").replace("HISTORY", "POLICY"))
    first, second = (re.search(rf"```{kind}\n(#include.*?)```", PAGE, re.DOTALL)[1] for kind in ("c", "cpp"))
    assert first.count("\n") < 18
    assert second.count("\n") < 40
    (tmp_path / "main.c").write_text(first)
    # A computer that is busy misses deadlines: here each decision comes in time.
    second = second.replace("now = steady_clock::now();", "now = next;")
    (tmp_path / "main.cpp").write_text(second.replace("std::this_thread::sleep_until(", "static_cast<void>("))
    printed = run(tmp_path, ["cc", "-std=c99", *WARNINGS, "main.c", "policy.c", "-lm", "-o", "main"]).split()
    assert printed[:3] == ["0", "0", "1"]
    subprocess.run(["cc", "-std=c99", "-c", "policy.c"], cwd=tmp_path, check=True)
    if shutil.which("c++"):
        words = ["c++", "-std=c++17", *WARNINGS, "main.cpp", "policy.o", "-lm", "-o", "main"]
        pitch, yaw = map(float, run(tmp_path, words).split())
        assert 0.02 < yaw < 0.3
        assert abs(pitch) < 0.3
    if pytest.importorskip("onnxruntime"):
        monkeypatch.chdir(tmp_path)
        Path("policy.onnx").write_bytes(print_onnx(trace_decision(made("history")[0]), {}))
        exec(re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)[1], found := {})
        assert_allclose(found["command"], [float(each) for each in printed[3:]], atol=5e-3)
    other, *_ = exported("no-lead")
    both = "int main(void) { return policy_self_test() + no_lead_self_test(); }"
    (tmp_path / "both.c").write_text(f'#include "policy.h"\n#include "no_lead.h"\n{both}')
    run(tmp_path, ["cc", f"-I{other.parent}", "both.c", "policy.c", other, "-lm", "-o", "main"])


@gcc
def test_check_compares_the_contract(exported):
    path, *_ = exported("no-lead")
    library, limits = ctypes.CDLL(path.with_suffix(".so")), made("no-lead")[0].rules.limits
    eight = np.float32([each[axis] for axis in range(2) for each in limits[:4]])

    def asked(period, numbers):
        return library.no_lead_check(ctypes.c_float(period), (ctypes.c_float * 8)(*numbers))

    assert (asked(0.02, eight), asked(0.01, eight), asked(np.nan, eight)) == (0, 1, 1)
    wrong = (eight + (0.01 + 0.01 * eight) * (np.arange(8) == at) for at in range(8))
    assert [asked(0.02, each) for each in wrong] == [*range(2, 10)]


def functions(x, y):
    """All elementary functions of two arrays, whose results are numbers."""
    xp = namespace(x)
    names = "abs sign floor round sin cos tanh exp expm1 square"
    of_one = [getattr(xp, each)(x) for each in names.split()]
    safe = xp.abs(x)
    of_one += [xp.sqrt(safe), xp.log(safe + 1e-30), xp.log1p(safe), x**3, -x, xp.clip(x, -1.0, 2.0)]
    pairs = [xp.atan2(x, y), xp.maximum(x, y), xp.minimum(x, y), x + y, x - y, x * y, x / (y + 1e-3)]
    both = (x < y) & (x <= 0.5) | ~(y > x) & (x >= -1.0) | (x == y) & (x != 1.0)
    return xp.stack([*of_one, *pairs, xp.where(both, x, y), xp.where(both, 1.0, 0.0 * x)], axis=-1)


def through_c(folder, outputs):
    """Compile symbols of the input "plate" as a function, plate → numbers."""
    facts = {"title": "", "made": "", "period_s": 0.02, "late_s": 0.05, "limits": [0.0] * 8, "robot": ""}
    facts |= {"robot_name": "", "stamp_offset_s": 0.0}
    examples = [*example_decisions(made("no-lead")[0], 1)]
    decision = Decision(outputs, outputs[:2], True, [0.0, 0.0, 0.0], False)
    for path, text in print_c(decision, facts, folder / "f.c", examples).items():
        path.write_bytes(text)
    subprocess.run(["cc", "-std=c99", "-O0", "-shared", "-fPIC", "f.c", "-o", "f.so", "-lm"], cwd=folder, check=True)
    (linked,) = re.findall(r"#define f_decide (\w+)", (folder / "f.h").read_text())
    library = ctypes.CDLL(folder / "f.so")

    def call(*values):
        memory, seen = (ctypes.c_float * (len(outputs) + 3))(), np.zeros(16, np.float32)
        seen[10 : 10 + len(values)] = values
        library[linked](memory, seen.tobytes(), (ctypes.c_float * 6)())
        return np.array(memory[: len(outputs)])

    return call


@gcc
def test_elementary_functions_are_those_of_numpy_in_c_onnx_and_jax(tmp_path, quick_jit):
    x = Trace().like(np.zeros(3), "input", "plate")
    outputs = scalars_of(functions(x[..., 0], x[..., 1]))
    edges = [0.0, -0.0, 1e-40, 1e-8, 0.5, -0.5, 1.5, 2.5, -2.5, 1.0, -1.0, 3.1415927, 80.0, -80.0, 1e5, -1e5]
    x, y = (each.reshape(-1) for each in np.meshgrid(*[np.float32(edges)] * 2))
    with np.errstate(all="ignore"):
        expected, call = functions(x, y), through_c(tmp_path, outputs)
    assert_allclose([call(*each) for each in zip(x, y, strict=True)], expected, rtol=2e-6, atol=1e-37)
    assert np.isnan(call(np.nan, 1.0)[[1, 16, 17, 18]]).all()  # as NumPy
    normal = np.all(np.abs([x, y]) != np.float32(1e-40), axis=0)  # which JAX takes for zero
    assert_allclose(quick_jit(functions)(x, y)[normal], expected[normal], rtol=2e-5, atol=1e-6)
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(print_onnx(Decision(outputs, outputs[:2], True, [0.0] * 3, False), {}))
    types = {"tensor(float)": np.float32, "tensor(bool)": bool}
    given = {each.name: np.zeros(each.shape, types[each.type]) for each in session.get_inputs()}
    plates = np.stack([x, y, 0.0 * x], axis=-1)
    found = [session.run(["next_memory"], given | {"plate": each})[0] for each in plates]
    assert_allclose(found, expected, rtol=2e-5, atol=1e-6)


class Pair(NamedTuple):
    one: Any
    other: Any


@gcc
def test_a_fold_over_frames_and_a_repetition_are_loops_that_give_what_numpy_gives(tmp_path):
    def total(places):
        begun = Pair(0.0 * places[..., 0, 0], 0.0 * places[..., 0, 1])
        state = fold(lambda s, p: Pair(s.one * 0.5 + p[..., 0], s.other - p[..., 1] * s.one), begun, places, 0)
        return repeat(lambda s: Pair(s.other, s.one + s.other), 5, state)

    place, places = np.float32([0.3, -0.2, 0.7]), np.float32([[1.0, 2.0, 3.0], [0.5, 0.1, 0.2], [2.0, 0.3, 0.4]])
    symbols = Trace().like(np.zeros(3), "input", "plate")[None] * places
    outputs = scalars_of(total(symbols))
    assert sum(isinstance(each, tuple) for each in schedule(outputs)) == 2
    assert_allclose(through_c(tmp_path, outputs)(*place), scalars_of(total(place * places)), rtol=1e-6)


class Own(NamedTuple):
    """A controller of one's own, of one line."""

    turn: Any

    def reset(self, seen, truth=None):
        return 0.0 * seen.command

    def step(self, state, seen):
        return state, aim(self.turn(seen.command))


REFUSED = {
    "it needs where or select": lambda angle: angle if angle[..., 0] > 0.0 else 0.0 * angle,
    "a power of 0.5 can't be traced": lambda angle: abs(angle) ** 0.5,
    "cosh can't be traced, only absolute, add": lambda angle: np.cosh(angle),
}


@pytest.mark.parametrize("complaint", REFUSED)
def test_a_controller_whose_formulas_can_not_be_traced_is_refused(complaint):
    own = Gated(Own(REFUSED[complaint]), gate_rules(PAPER, TASK))
    with pytest.raises(TypeError, match=complaint):
        trace_decision(own)


def test_what_can_not_be_exported_is_refused_and_nothing_is_written(tmp_path, refused, monkeypatch):
    (mine := tmp_path / "mine.c").write_text("int main(void) {}")
    trained = policy("history", PAPER)
    refused("expected a name that ends with .c or .onnx", export, trained, tmp_path / "policy.txt")
    refused("mine.c: was not written by export; name another file", export, trained, mine)
    mine.rename(mine := tmp_path / "mine.h")
    refused("mine.h: was not written by export", export, trained, tmp_path / "mine.c")
    refused("has no quotes", export, trained, tmp_path / 'a".c')
    refused("Math.h would hide the C library's math.h; name another", export, trained, tmp_path / "Math.c")
    refused("was trained in other records than infantry's; name", export, trained, tmp_path / "a.c", INFANTRY)
    refused("oracle knows the target's path", export, "oracle", tmp_path / "a.c")
    refused("tuning: expected .kept., .start., .*got 'best'", export, "kalman", tmp_path / "a.c", tuning="best")
    refused("perhaps you meant kalman", export, "kalmn", tmp_path / "a.c")
    near = TASK.replace(command_limit="los-2deg")
    monkeypatch.setattr("archerfish.evaluation.tuning_search.tune", lambda *_: 1 / 0)  # takes minutes, and comes last
    refused("as no robot knows; take gate or box", export, "kalman", tmp_path / "a.c", PAPER, near)
    monkeypatch.setattr("archerfish.studies.export.MOST", -1.0)
    if shutil.which("cc"):
        refused("differs by .* rad from NumPy; nothing is written", export, trained, tmp_path / "a.c")
    assert [each.name for each in tmp_path.iterdir()] == ["mine.h"]


def test_without_compiler_or_onnx_it_is_said_what_was_not_checked(tmp_path, refused, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    for end in (".c", ".onnx"):
        report = af.export("kalman", tmp_path / f"lq{end}", task="paper")
        assert report.headline == f"lq{end} is written, but was not compared with NumPy."
        assert "install a C compiler or ONNX Runtime" in report.next_steps[-1]
    monkeypatch.setitem(sys.modules, "onnx", None)
    refused("the package onnx is not installed", export, "kalman", tmp_path / "x.onnx", task="paper")


@gcc
def test_the_command_exports_with_the_settings_that_the_folder_holds(tmp_path, monkeypatch, capsys, refused):
    monkeypatch.setattr("archerfish.evaluation.tuning_search.rates", lambda *_: lambda each: 0.5 - each.initial_speed)
    INFANTRY.save(tmp_path)
    robot, path = af.Robot.load(tmp_path), tmp_path / "mine.c"
    tuning = af.tune("kalman", robot, TASK)
    words = ["export", str(tmp_path), "--controller", "kalman", "--task", "paper", "--out", str(path)]
    main(words)
    printed, text = capsys.readouterr().out, path.read_text()
    assert "mine.c decides as kalman does in NumPy." in printed
    wrote, following = printed.splitlines()[-2:]
    assert wrote.startswith(f"wrote {tmp_path}/mine.c and {tmp_path}/mine.h (")
    assert following == f"next: cc -O2 -ffp-contract=off -c {path}  # docs/export.md"
    af.export("kalman", path, robot, "paper", tuning={"kalman": tuning})
    assert path.read_text() == text
    main([*words, "--tuning", "start"])
    assert path.read_text() != text
    policy("tracked", robot).save(tmp_path / "policy" / "policy.safetensors")
    main(["export", str(tmp_path)])
    with pytest.raises(SystemExit, match="2"):
        main(["export", "--out", str(tmp_path / "none.c")])
    assert "runs/train: no such policy; train it" in capsys.readouterr().err
    assert {each.name for each in tmp_path.glob("policy.*")} == {"policy.c", "policy.h"}
    (tmp_path / "tuning.json").write_text('{"tunings": [{"controller": "kalman"}]}')
    refused("tuning.json: .*remove it, and it is made again", export, "kalman", path, robot, TASK)


def test_a_policy_is_given_by_any_file_or_its_folder_everywhere(tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    trained, short = policy("history", PAPER), TASK.replace(ranges_m=((2, 3),))
    Path("folder").mkdir()
    for name in ("pol", "pol.safetensors", "folder"):
        trained.save(name)
        assert plain(af.Policy.load(name).facts) == plain(trained.facts)
        assert export(name, "policy.c").title == "Export of policy"
        assert {cell.kind for cell in af.evaluate(name, task=short, engagements=2).cells} == {"policy"}
    Path("begun").mkdir()
    for file in ("run.json", "checkpoint.safetensors"):
        (tmp_path / "begun" / file).write_text("{}")
    complaint = "begun: is a training that is not finished; run archerfish train --resume begun"
    for call in (af.Policy.load, af.evaluate, functools.partial(export, path="policy.c")):
        refused(complaint, call, "begun")


def test_commands_that_are_no_numbers_are_found_by_the_comparison(refused, tmp_path):
    class Late(NamedTuple):
        zero: Any

        def reset(self, seen, truth=None):
            return 0.0 * seen.elapsed

        def step(self, state, seen):
            xp = namespace(state)
            return state + 1.0, aim(xp.where(state > 50.0, float("nan"), 0.1) + 0.0 * seen.command)

    for end in [".c"] * bool(shutil.which("cc")) + [".onnx"]:
        refused("differs by nan rad from NumPy; nothing is written", export, Late(np.zeros(())), tmp_path / f"x{end}")


def test_reductions_with_options_are_refused():
    x = Trace().like(np.zeros(3), "input", "plate")
    for wrong in (lambda: np.max(x, initial=0.5), lambda: np.sum(x, where=x > 0.0), lambda: np.add.accumulate(x)):
        with pytest.raises(TypeError, match="with such options can't be traced"):
            wrong()
