"""The words of an identified sensing: what is known of camera and link, how sure that is, and what to record next."""

from collections.abc import Iterator
from typing import NamedTuple

from archerfish.cli.interval_words import with_margin
from archerfish.identification.sensing.estimate import SensingIdentification
from archerfish.records.sensing import sensing_values

LABELS = {
    "camera.rate_hz": ("camera rate", "Hz", 1.0),
    "camera.time_offset": ("time offset to gimbal", "ms", 1e3),
    "camera.stamp_jitter": ("jitter of the stamps", "ms", 1e3),
    "camera.latency": ("camera latency", "ms", 1e3),
    "camera.latency_jitter": ("its jitter", "ms", 1e3),
    "camera.bearing_sd": ("noise across, azimuth", "mrad", 1e3),
    "camera.elevation_sd": ("noise across, elevation", "mrad", 1e3),
    "camera.range_sd": ("noise along", "mm", 1e3),
    "camera.miss_probability": ("missed frames", "%", 100.0),
    "camera.outlier_share": ("not the plate", "%", 100.0),
    "link.command_delay": ("command to motion, both ways", "ms", 1e3),
    "link.command_jitter": ("its jitter", "ms", 1e3),
    "link.feedback_delay": ("of it, feedback", "ms", 1e3),
    "link.command_latency": ("command latency", "ms", 1e3),
    "link.command_latency_jitter": ("its jitter", "ms", 1e3),
    "link.feedback_latency": ("feedback latency", "ms", 1e3),
    "link.feedback_latency_jitter": ("its jitter", "ms", 1e3),
    "link.feedback_rate_hz": ("feedback rate", "Hz", 1.0),
    "link.feedback_quantum": ("step of the feedback", "mrad", 1e3),
}
"""Each quantity in words, with the unit that it is told in and what turns it into that unit."""

_LOOSE_S = 2e-3
"""Half width of a time's interval beyond which recording more pays [s]: a target at 3 m/s moves 6 mm in it."""
_FEW_STEPS = 15
_DOUBTED_OUTLIERS = 0.1
_MISSED = 0.3


class SensingVerdict(NamedTuple):
    """What a person should know of an identified sensing."""

    headline: str
    """All in one line."""
    known: tuple[str, ...]
    """What is known, each a sentence."""
    doubts: tuple[str, ...]
    """What puts the estimate in question, each in sentences that say what to check."""
    next_steps: tuple[str, ...]
    """What to record, the most useful first, each in sentences."""


def sensing_verdict(result: SensingIdentification) -> SensingVerdict:
    """Judge an identified sensing."""
    return SensingVerdict(_headline(result), tuple(_known(result)), tuple(_doubts(result)), tuple(_next_steps(result)))


def told(result: SensingIdentification, name: str) -> str:
    """Write a measured quantity with its interval and its unit; "not known" if it was not measured."""
    value = sensing_values(result.sensing).get(name)
    if value is None:
        return "not known"
    _, unit, scale = LABELS[name]
    return f"{with_margin(value, result.sensing.intervals.get(name), scale)} {unit}"


def latency_label(result: SensingIdentification) -> str:
    """Say what the latency counts from."""
    less = " less the feedback's delay" if result.sensing.camera.latency_basis == "feedback" else ""
    return f"camera latency{less}"


def detections_used(result: SensingIdentification) -> tuple[int, int]:
    """Return how many detections of the plate at rest were used, and how many there are."""
    inlier = result.alignment.inlier
    return int(inlier.sum()), inlier.size + result.outside


def left_out(result: SensingIdentification) -> list[str]:
    """Say what of the recordings was left out and why, each a sentence."""
    used, logged = detections_used(result)
    sentences = []
    if used < logged:
        reasons = {
            "not the plate at rest": result.alignment.inlier.size - used,
            "at moments at which the gimbal's angle is not logged": result.outside,
        }
        words = ", ".join(f"{count} {reason}" for reason, count in reasons.items() if count)
        sentences.append(f"{used} of {logged} detections used; left out: {words}.")
    for what, used, logged, why in (
        ("command", result.command_steps, result.command_steps_logged, "show no clear beginning of the motion"),
        ("target", result.target_steps, result.target_steps_logged, "do not show in the detections"),
    ):
        if used < logged:
            sentences.append(f"{used} of {logged} steps of the {what} used; the others {why}.")
    return sentences


def _headline(result: SensingIdentification) -> str:
    camera = result.sensing.camera
    across = 1e3 * camera.bearing_sd * camera.noise_range
    used, logged = detections_used(result)
    count = f"; {used} of {logged} detections used" if used < logged else ""
    return (
        f"sensing: camera {told(result, 'camera.rate_hz')}, {latency_label(result).removeprefix('camera ')} "
        f"{told(result, 'camera.latency')}, time offset {told(result, 'camera.time_offset')}, noise {across:.2g} mm "
        f"across at {camera.noise_range:.2g} m{count}; command to motion {told(result, 'link.command_delay')}"
    )


def _known(result: SensingIdentification) -> Iterator[str]:
    yield from left_out(result)
    camera, link = result.sensing.camera, result.sensing.link
    yield (
        f"The camera sends {told(result, 'camera.rate_hz')} and misses the plate in "
        f"{told(result, 'camera.miss_probability')} of its frames."
    )
    if camera.latency is not None:
        what = "exposed" if camera.latency_basis == "exposure" else "exposed, counted in the gimbal's logged motion,"
        yield f"A detection reaches the program {told(result, 'camera.latency')} after its frame was {what} on average."
    yield (
        f"Add {told(result, 'camera.time_offset')} to a frame's stamp to get the moment of its exposure in the "
        f"gimbal's log; single stamps are off by {told(result, 'camera.stamp_jitter')} (standard deviation)."
    )
    distance = camera.noise_range
    yield (
        f"A plate at {distance:.2g} m is seen with a noise of {1e3 * camera.bearing_sd * distance:.2g} mm to the side, "
        f"{1e3 * camera.elevation_sd * distance:.2g} mm in height and {1e3 * camera.range_sd:.2g} mm in distance "
        "(standard deviations)."
    )
    if link.command_delay is not None:
        yield (
            f"From a command to the first logged motion {told(result, 'link.command_delay')} pass, feedback included, "
            f"and {told(result, 'link.command_jitter')} more or less from step to step (standard deviation)."
        )
    for name, way in (("command", "A command reaches the gimbal"), ("feedback", "A report of the gimbal arrives")):
        if getattr(link, f"{name}_latency") is not None:
            yield (
                f"{way} {told(result, f'link.{name}_latency')} after it was sent, and "
                f"{told(result, f'link.{name}_latency_jitter')} more or less from message to message (standard "
                "deviation)."
            )


def _doubts(result: SensingIdentification) -> Iterator[str]:
    if result.misfit.shown:
        yield (
            f"The gimbal's motion still explains {100 * result.misfit.share:.0f} % of what the alignment leaves of the "
            "plate's bearing: a lens that was not calibrated, a plate or robot that moved, or a clock that jumped. "
            "The intervals know nothing of that; calibrate the camera, and sweep again."
        )
    outliers = result.sensing.camera.outlier_share
    if outliers > _DOUBTED_OUTLIERS:
        yield (
            f"{100 * outliers:.0f} % of the detections are not the plate at rest, and were left out: leave one plate "
            "in view, and cover what else looks like one."
        )
    if result.sensing.camera.miss_probability > _MISSED:
        yield (
            f"The plate was missed in {100 * result.sensing.camera.miss_probability:.0f} % of the frames: bring it "
            "nearer, light it better, or sweep less wide."
        )


def _next_steps(result: SensingIdentification) -> Iterator[str]:
    yield from result.missing
    intervals = result.sensing.intervals
    low, high = intervals["camera.time_offset"]
    if high - low > 2 * _LOOSE_S:
        yield "Sweep faster, wider and longer: the time offset is known to no better than 2 ms."
    for name, count, what in (
        ("camera.latency", result.target_steps, "target"),
        ("link.command_delay", result.command_steps, "command"),
    ):
        if (
            name in intervals
            and count
            and (intervals[name][1] - intervals[name][0] > 2 * _LOOSE_S or count < _FEW_STEPS)
        ):
            more = "more" if count >= _FEW_STEPS else "some twenty"
            yield f"Record {more} steps of the {what}; {count} tell {told(result, name)}."
    link = result.sensing.link
    if link.command_delay is not None and link.feedback_delay is None and link.command_latency is None:
        yield (
            "To split the command-to-motion delay into the command's and the feedback's, record a target that steps at "
            "known moments."
        )
