import re
from dataclasses import replace

import numpy as np
import pytest

from archerfish.cli.sensing_page import sensing_page
from archerfish.cli.sensing_summary import sensing_summary
from archerfish.cli.sensing_verdict import sensing_verdict
from archerfish.identification.sensing.estimate import identify_sensing
from archerfish.identification.sensing.motion_misfit import MotionMisfit


@pytest.fixture(scope="module")
def recordings(sensing_recordings):
    robot, rng = sensing_recordings.Robot(), np.random.default_rng(4)
    gimbal, plate = sensing_recordings.sweep_recording(robot, rng, seconds=8.0)
    steps, target, moments = sensing_recordings.step_recording(robot, rng, steps=20)
    return gimbal, plate, steps, target, moments


@pytest.fixture(scope="module")
def whole(recordings):
    gimbal, plate, steps, target, moments = recordings
    return identify_sensing([gimbal, steps], [plate, target], moments)


@pytest.fixture(scope="module")
def alone(recordings):
    return identify_sensing([recordings[0]], [recordings[1]])


def page_of(result):
    record = replace(result.sensing, provenance={"seed": 0})
    return sensing_page(result, record, sensing_verdict(result), "sensing")


def test_the_verdict_comes_first_with_rate_latency_offset_and_delay(whole):
    verdict, page = sensing_verdict(whole), page_of(whole)
    number = r"−?[\d.]+(±[\d.]+| \([^)]*\))"
    pattern = rf"sensing: camera {number} Hz, latency {number} ms, time offset {number} ms, noise [\d.]+ mm across at "
    assert re.match(pattern, verdict.headline)
    assert verdict.doubts == ()
    (stamps,) = verdict.next_steps
    assert "Give --commands and --feedback" in stamps
    assert page.index(verdict.headline) < page.index("What is known") < page.index("Do camera and gimbal")
    assert "no lack of fit" in " ".join(page.split())


def test_the_page_stands_alone(whole):
    page = page_of(whole)
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!#)', page)
    assert page.count("<svg") == 4
    ids = re.findall(r'\bid="([^"]+)"', page)
    assert len(ids) == len(set(ids))


def test_every_estimated_number_has_unit_and_interval(whole):
    page = page_of(whole)
    for label, unit in (("camera latency", "ms"), ("its jitter", "ms"), ("missed frames", "%"), ("noise along", "mm")):
        assert re.search(rf"<th>{label}</th><td[^>]*>[\d.]+ {unit}</td><td>[\d.]+ … [\d.]+ {unit}</td>", page), label


def test_what_a_sweep_alone_leaves_open_is_what_to_record_next(alone):
    verdict, page = sensing_verdict(alone), page_of(alone)
    assert "latency less the feedback&#39;s delay" in page or "latency less the feedback's delay" in page
    assert verdict.headline.endswith("command to motion not known")
    assert ["--target-steps" in verdict.next_steps[0], "steps of the command" in verdict.next_steps[1]] == [True, True]


def test_detections_that_were_left_out_are_counted_with_the_reason(alone):
    page = page_of(alone)
    count = int((~alone.alignment.inlier).sum())
    assert count > 0
    assert f'<th>detections left out</th><td>{count}</td><td class="text">off by more than five' in page


def test_an_alignment_that_misses_something_is_doubted_first(alone):
    bent = replace(alone, misfit=MotionMisfit(0.2, 1e-9))
    verdict, page = sensing_verdict(bent), page_of(bent)
    assert "explains 20 %" in verdict.doubts[0]
    assert page.index('class="warning"') < page.index("What is known")


def test_few_steps_ask_for_more(recordings):
    gimbal, plate, steps, target, moments = recordings
    kept = steps.time < 1.0 + 0.6 * 8
    fewer = type(steps)(steps.time[kept], steps.yaw[kept], steps.pitch[kept], steps.command[kept], steps.source)
    verdict = sensing_verdict(identify_sensing([gimbal, fewer], [plate, target], moments))
    assert any("some twenty steps of the command" in each for each in verdict.next_steps)


def test_what_was_left_out_of_detections_and_steps_is_said_in_verdict_page_and_summary(recordings):
    gimbal, plate, steps, target, moments = recordings
    # A quarter of a second is missing in the sweep, and two moments are of steps that the target did not make.
    kept = np.abs(gimbal.time - gimbal.time.mean()) > 0.125
    gapped = type(gimbal)(gimbal.time[kept], gimbal.yaw[kept], gimbal.pitch[kept], gimbal.command[kept], gimbal.source)
    result = identify_sensing([gapped, steps], [plate, target], np.append(moments, moments[-1] + [3.0, 5.0]))
    verdict, page, facts = (
        sensing_verdict(result),
        page_of(result),
        sensing_summary(result, sensing_verdict(result), []),
    )
    used, logged = facts["detections"]["used"], plate.time.size
    assert facts["detections"]["logged"] == logged
    assert facts["detections"]["angle_not_logged"] == result.outside >= 0.25 * 60
    assert f"; {used} of {logged} detections used; command to motion" in verdict.headline
    sentence = f"{result.outside} at moments at which the gimbal's angle is not logged."
    assert any(sentence in each for each in verdict.known)
    assert any(sentence in each for each in facts["remarks"])
    assert f"{moments.size} of {moments.size + 2} steps of the target used" in " ".join(facts["remarks"])
    assert "<th>steps of the target left out</th><td>2</td>" in page
