"""What a person should know about an identified sensing: what its numbers mean, and what may spoil them."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from archerfish.identification.sensing.gimbal_track import Feedback, GimbalTrack
from archerfish.identification.sensing.plate_alignment import PlateAlignment
from archerfish.identification.sensing.stamp_timing import Z95, FrameTiming
from archerfish.records.sensing import CameraRecord, LinkRecord
from archerfish.records.sensing_logs import GimbalLog

_LARGE_NOISE = 0.05
"""Scatter across the line of sight [m] beyond that of any detector: about the half height of an armor plate."""


class Doubts(NamedTuple):
    """What doubts are raised from."""

    log: GimbalLog
    """The gimbal during the sweep."""
    feedback: Feedback
    """Its feedback."""
    track: GimbalTrack
    """Its angles between samples."""
    frames: FrameTiming
    """Frames of the sweep."""
    alignment: PlateAlignment
    """How they lie on the gimbal's log."""
    camera: CameraRecord
    """What was found about the camera."""
    link: LinkRecord
    """What was found about the link."""


def doubts(found: Doubts) -> Iterator[str]:
    """Yield remarks, each a sentence or two."""
    yield from _of_camera(found)
    yield from _of_link(found)


def _of_camera(found: Doubts) -> Iterator[str]:
    alignment, frames, camera = found.alignment, found.frames, found.camera
    if Z95 * alignment.offset_sd > 2e-3:
        yield (
            f"The time offset is known to ±{1e3 * Z95 * alignment.offset_sd:.1f} ms only: sweep faster, wider, longer."
        )
    span = float(np.ptp(alignment.moments))
    if abs(alignment.drift) > 4 * alignment.drift_sd and abs(alignment.drift) * span > 2e-4:
        yield (
            f"The clocks of camera and gimbal drift apart by {1e6 * alignment.drift:.0f} ppm: the time offset holds "
            "for the middle of the sweep; synchronise the clocks, or estimate it anew in each run."
        )
    if frames.jitter > 0.15 * frames.period:
        yield (
            f"Intervals between stamps scatter by {frames.jitter / frames.period:.0%} of the frame period, so missed "
            "frames are miscounted; stamp the frames on exposure."
        )
    if frames.out_of_view:
        yield (
            f"The plate was out of view {frames.out_of_view} times for more than 0.25 s; that doesn't count as missed."
        )
    if camera.outlier_share > 0.1:
        yield f"{camera.outlier_share:.0%} of the detections are not the plate; the noise is that of the others."
    across = camera.noise_range * max(camera.bearing_sd, camera.elevation_sd)
    if across > _LARGE_NOISE:
        yield f"Detections scatter by {1e3 * across:.0f} mm across the line of sight: was it one plate, at rest?"
    if np.ptp(found.track.angles(alignment.moments)[:, 1]) > np.radians(3):
        yield "The pitch moved by more than 3° during the sweep; hold it still."
    yield (
        f"The noise was measured with the plate at {camera.noise_range:.1f} m; how it grows with the distance takes a "
        "recording at another one."
    )


def _of_link(found: Doubts) -> Iterator[str]:
    link = found.link
    if not found.feedback.fresh.all():
        yield (
            f"The logged yaw is refreshed {link.feedback_rate_hz:.0f} times a second only and held between; "
            "the time offset and the delay are those of the refreshed values."
        )
    if link.command_delay is not None:
        stamped = link.command_latency is not None or link.feedback_latency is not None
        more = (
            ", and of how long the gimbal takes to start."
            if stamped
            else ": a log of commands and feedback can't show more."
        )
        yield (
            f"The command-to-motion delay is the sum of command and feedback delay{more} A plant identified from such "
            "a log holds it already."
        )
    if link.feedback_delay is not None and found.camera.latency is not None:
        low = link.feedback_delay < -0.003
        yield (
            "The feedback's delay comes out below zero: stamp target steps, receipts and gimbal log by one clock."
            if low
            else "Target steps and the sweep together tell the feedback's delay; the rest of the sum is the command's."
        )
