"""A wire that no table covers: its reports have the microcontroller's time, and the last byte is the sum of the others.

In deploy.toml of the robot's folder: wires = ["./our_wire.py:OurWire"]
"""

import numpy as np

from archerfish.authors import Feedback, Layout, WireReports

REPORT = "= 5A A5 01", "time_ms u32", "switch u8", "pitch f32", "yaw f32", "yaw_encoder f32", "rates f32 x2", "sum u8"
COMMAND = "= 5A A5 02", "state u8", "pitch f32", "yaw f32", "sum u8"


def with_sum(frame):
    return frame[:-1] + bytes([sum(frame[:-1]) % 256])


class OurWire:
    has_base_yaw = True  # a gyroscope's yaw, and the encoder's beside it

    def __init__(self):
        self.report, self.command = Layout("report", REPORT), Layout("command", COMMAND)
        self.received = [self.report]  # what is looked for in the stream

    def decode(self, frames):
        reports = [self.report.decode(frame.data) for frame in frames if frame.data == with_sum(frame.data)]

        def column(name):
            return np.array([report[name] for report in reports], float)

        pitch, yaw, turned = column("pitch"), column("yaw"), column("yaw") - column("yaw_encoder")
        sampled_s, unknown = 1e-3 * column("time_ms"), np.full(len(reports), np.nan)
        angle, rate = np.stack([pitch, yaw], axis=-1), column("rates").reshape(-1, 2)  # pitch and yaw [rad, rad/s]
        return WireReports(
            feedback=Feedback(sampled_s, unknown, angle, rate),  # the clock's offset is estimated
            switch_on=column("switch") == 1,
            muzzle_speed=unknown,
            shots_left=unknown,
            base_yaw=np.remainder(turned + np.pi, 2.0 * np.pi) - np.pi,
        )

    def encode(self, command):
        state = 0 if not command.control else 2 if command.fire else 1
        pitch, yaw = command.angle.tolist()
        return with_sum(self.command.encode({"state": state, "pitch": pitch, "yaw": yaw}))
