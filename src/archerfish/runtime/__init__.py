"""What runs on the robot's computer: from received bytes to the bytes that are sent."""

from archerfish.runtime.pilot import Pilot

__all__ = ["Pilot"]
