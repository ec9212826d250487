from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from archerfish.cli.axis_evidence import Log, gather_evidence, pole_evidence
from archerfish.cli.axis_page import axis_page
from archerfish.cli.axis_summary import axis_summary, print_axis
from archerfish.cli.axis_verdict import verdict
from archerfish.identification.axis.gimbal import identify_axis
from archerfish.identification.axis.state_space import simulate
from archerfish.identification.excitation.signals import linear_sweep, step
from archerfish.records.findings import Finding
from archerfish.records.plant import PlantRecord
from archerfish.records.recording import make_recording

PERIOD = 0.005
# 5 Hz, damping 0.5, steady gain 1, delay 10 ms.
POLE = np.exp(2 * np.pi * 5 * PERIOD * (-0.5 + 1j * np.sqrt(0.75)))
A = np.array([[2 * POLE.real, 1.0], [-(abs(POLE) ** 2), 0.0]])
C = np.array([[1.0, 0.0]])
B = np.ones((2, 1)) / (C @ np.linalg.solve(np.eye(2) - A, np.ones((2, 1))))
PLANT = PlantRecord(A, B, C, np.zeros((1, 1)), 2, PERIOD)


def log(name, signal, *, noise=0.01, seed=0, change=lambda y: y):
    clean = simulate(PLANT, signal[:, None])[:, 0]
    measured = change(clean) + noise * clean.std() * np.random.default_rng(seed).standard_normal(clean.size)
    return Log(Path(name), make_recording(signal, measured, PERIOD, source=name))


SWEEP = log("sweep.csv", linear_sweep(5.0, PERIOD, high_hz=20.0))
STEP = log("step_1.csv", step(2.0, PERIOD, start_s=0.5), seed=1)
STEP_2 = log("step_2.csv", -2 * step(2.0, PERIOD, start_s=0.5), seed=2)


def drawn(result, spread=0.01):
    """The axis with 50 posterior draws whose gains and frequencies scatter by a share."""
    plant, rng = result.plant, np.random.default_rng(3)
    values, vectors = np.linalg.eig(plant.A.astype(complex))
    powers = 1 + spread * rng.standard_normal(50)
    scatter = {
        "A": np.stack([(vectors * values**power @ np.linalg.inv(vectors)).real for power in powers]),
        "B": plant.B * (1 + spread * rng.standard_normal((50, 1, 1))),
        "C": np.broadcast_to(plant.C, (50, *plant.C.shape)),
        "D": np.broadcast_to(plant.D, (50, *plant.D.shape)),
    }
    interval = (1 - 1.96 * spread, 1 + 1.96 * spread)
    scattered = replace(plant, draws=scatter, draw_delays=np.zeros(0, np.int64))
    return replace(result, plant=scattered, dc_gain_interval=(interval,))


def judged(training, validation, *, spread=None, order=2, findings=(), max_delay=5, **facts):
    result = identify_axis([each.recording for each in training], order, max_delay=max_delay, axis="yaw")
    result = replace(result if spread is None else drawn(result, spread), **facts)
    evidence = gather_evidence(result, training, validation, findings)
    return evidence, verdict(evidence)


def test_a_sweep_alone_is_told_in_one_line_with_what_to_add():
    _, found = judged([SWEEP], [STEP_2])
    line = found.headline
    assert line.startswith("yaw: 2nd order, delay 10 ms (10–15 ms), fit 9")
    assert line.endswith(" Hz: add a step log")
    assert " % on step_2; nothing is known below 1." in line
    assert found.usable
    assert "Add a log of a step" in found.next_steps[0]


def test_with_a_step_and_a_log_held_back_there_is_nothing_left_to_do():
    _, found = judged([SWEEP, STEP], [STEP_2])
    assert "nothing is known" not in found.headline
    assert found.next_steps == ()
    assert found.doubts == ()


def test_without_a_log_held_back_the_worst_fitted_one_is_named():
    _, found = judged([SWEEP, STEP], [])
    assert "(fitted, none held back)" in found.headline
    assert any("--validate LOG" in each for each in found.next_steps)


@pytest.mark.parametrize(
    ("span", "words"), [((2, 2), "10 ms,"), ((1, 3), "10±5 ms,"), ((2, 4), "10 ms (10–20 ms),"), ((0, 3), "0–15 ms")]
)
def test_the_delay_is_given_with_its_range(span, words):
    _, found = judged([SWEEP, STEP], [STEP_2], delay_range=span)
    assert words in found.headline
    assert any("sharp edges" in each for each in found.next_steps) == (span == (0, 3))


def test_a_response_later_than_the_longest_delay_asks_to_raise_it():
    late = [
        log(name, signal, change=lambda y: np.append(np.zeros(30), y[:-30]))
        for name, signal in (
            ("sweep.csv", linear_sweep(5.0, PERIOD, high_hz=20.0)),
            ("step.csv", step(2.0, PERIOD, start_s=0.5)),
        )
    ]
    evidence, found = judged(late, [], max_delay=20)
    assert evidence.result.later_delay == pytest.approx(32, abs=3)
    (told,) = (each for each in found.doubts if "clearly better" in each)
    assert "leave --max-delay out" in told
    assert not found.usable
    assert "late" in found.reasons
    assert axis_summary(evidence, found, [])["later_delay_samples"] == evidence.result.later_delay
    evidence, found = judged(late, [], max_delay=None)
    assert evidence.result.plant.delay_samples == pytest.approx(32, abs=3)
    assert "late" not in found.reasons


@pytest.mark.parametrize(("delay", "span", "words"), [(5, (4, 5), "is the longest that was tried"), (2, (1, 3), None)])
def test_a_delay_at_the_longest_that_was_tried_makes_a_plant_useless(delay, span, words):
    evidence, _ = judged([SWEEP, STEP], [STEP_2], delay_range=span)
    plant = replace(evidence.result.plant, delay_samples=delay)
    found = verdict(replace(evidence, result=replace(evidence.result, plant=plant)))
    said = [each for each in found.doubts if "leave --max-delay out" in each]
    assert len(said) == bool(words)
    assert all(words in each for each in said)
    assert ("late" in found.reasons) == bool(words)


def test_a_loose_steady_gain_asks_for_a_longer_step():
    for spread, told in ((0.1, True), (0.001, False)):
        evidence, found = judged([SWEEP, STEP], [STEP_2], spread=spread)
        assert any("The steady gain from u is not known to 5%" in each for each in found.doubts) == told
        assert ("gain" in found.reasons) == told
        ((low, high),) = evidence.result.dc_gain_interval
        assert low < 1 < high


def test_what_the_plant_misses_is_told_with_its_share():
    backlash = log(
        "backlash.csv", STEP_2.recording.inputs[:, 0], change=lambda y: y - 0.3 * np.sign(y) * (abs(y) > 0.1)
    )
    _, found = judged([SWEEP, STEP], [backlash])
    (told,) = (each for each in found.next_steps if "Past inputs still explain" in each)
    assert "backlash.csv" in told
    assert any("points worse" in each for each in found.next_steps)


def test_poles_that_no_input_excited_are_called_guesses():
    evidence, found = judged([SWEEP, STEP], [STEP_2], order=4, spread=0.01)
    unknown = [each for each in pole_evidence(evidence.result) if not each.determined]
    assert unknown
    assert any(f"{len(unknown)} of 4 poles" in each for each in found.next_steps)


def test_a_pole_has_intervals_from_the_draws():
    evidence, _ = judged([SWEEP, STEP], [STEP_2], spread=0.01)
    pole = pole_evidence(evidence.result)[0]
    assert pole.frequency_hz == pytest.approx(5.0, rel=0.02)
    low, high = pole.frequency_interval_hz
    assert high - low == pytest.approx(2 * 1.96 * 0.01 * 5.0, rel=0.3)
    assert pole.damping == pytest.approx(0.5, abs=0.02)


def test_feedback_in_a_log_is_told():
    rng = np.random.default_rng(4)
    drift = np.zeros(1001)
    for index in range(1000):
        drift[index + 1] = 0.9 * drift[index] + 0.3 * rng.standard_normal()
    # The command follows the reference less the disturbance that was measured a sample before.
    signal = rng.standard_normal(1000) - 0.8 * drift[:-1]
    output = simulate(PLANT, signal[:, None])[:, 0] + drift[1:]
    closed = Log(Path("closed.csv"), make_recording(signal, output, PERIOD))
    _, found = judged([SWEEP, STEP], [closed])
    assert any("closed.csv the input follows the output" in each for each in found.doubts)
    assert "feedback" in found.reasons


FINDING = Finding("jitter", "warning", "sweep.csv: line 7", "intervals differ by <12 %", "log at a fixed rate", 12)


class Inspector(HTMLParser):
    """Collects what a page is made of."""

    def __init__(self):
        super().__init__()
        self.open, self.words, self.links, self.ids = [], [], [], []

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "br"):
            self.open.append(tag)
        self.links += [value for name, value in attrs if name in ("src", "href", "xlink:href") and value]
        self.ids += [value for name, value in attrs if name == "id"]

    def handle_startendtag(self, tag, attrs):
        self.handle_starttag(tag, attrs)
        self.open.pop()

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


SHORT = log("short.csv", step(0.5, PERIOD, start_s=0.1))


@pytest.fixture(scope="module")
def evidence():
    return judged([SWEEP], [STEP_2, SHORT], spread=0.01, findings=[FINDING])


@pytest.fixture(scope="module")
def page(evidence):
    return axis_page(*evidence, output="angle", unit="rad")


def test_the_page_is_whole_and_needs_nothing_else(page):
    inspector = Inspector()
    inspector.feed(page)
    assert not inspector.open
    assert all(link.startswith("#") for link in inspector.links)
    assert len(set(inspector.ids)) == len(inspector.ids)
    assert "<script" not in page


def test_the_page_begins_with_the_verdict_and_holds_all_sections(page, evidence):
    inspector = Inspector()
    inspector.feed(page)
    text = " ".join(" ".join(inspector.words).split())
    headline = text.index(evidence[1].headline)
    places = [text.index(each) for each in (evidence[1].next_steps[0], "step_2.csv", "z plane", "commit")]
    assert all(headline < place for place in places)
    for each in (*map(str, FINDING), "held back", "natural frequency", "rad"):
        assert each in text


def test_the_page_says_how_many_samples_were_used_and_why_others_were_not(page, evidence):
    count = sum(len(log.recording) for log in evidence[0].logs)
    assert f"; {count} of {count + 12} samples used" in evidence[1].headline
    assert f"<li>{count} of {count + 12} samples used; left out: 12 (jitter).</li>" in page


def test_a_log_too_short_to_test_is_said_to_be(page, evidence):
    assert evidence[0].logs[2].tests is None
    assert "too short to test" in page
    assert axis_summary(*evidence, [])["validation"][1]["residual"] is None


def test_the_terminal_begins_with_the_verdict_and_ends_with_what_to_do(evidence):
    _, found = evidence
    console = Console(record=True, width=200)
    print_axis(console, *evidence, [Path("yaw.json")])
    lines = console.export_text().splitlines()
    assert lines[0] == found.headline
    assert any("intervals differ by <12 %; log at a fixed rate" in line for line in lines)
    assert lines[-2] == f"• {found.next_steps[-1]}"
    assert lines[-1] == "wrote yaw.json"


def test_the_facts_hold_every_number_with_its_interval():
    evidence, found = judged([SWEEP, STEP], [STEP_2], spread=0.01, findings=[FINDING])
    facts = axis_summary(evidence, found, [])
    assert facts["delay_range_samples"][0] <= facts["delay_samples"] <= facts["delay_range_samples"][1]
    ((low, high),) = facts["dc_gain_interval"]
    assert low < facts["dc_gain"][0] < high
    assert facts["findings"] == [FINDING._asdict()]
    assert facts["validation"][0]["residual"]["independent_of_input"]
    # To the end of the sweep, and as far beyond as the response to the step can be heard.
    assert 19.0 < facts["excited_band_hz"][1] < 30.0


def test_a_held_back_log_with_another_zero_is_told_apart_from_a_bad_plant():
    moved = Log(Path("moved.csv"), replace(STEP_2.recording, outputs=STEP_2.recording.outputs + 0.5))
    evidence, found = judged([SWEEP, STEP], [moved])
    assert found.usable
    (told,) = (each for each in found.doubts if "without that shift" in each)
    assert "moved was held back and lies +0.5" in told
    assert evidence.logs[-1].unshifted_percent > 98
