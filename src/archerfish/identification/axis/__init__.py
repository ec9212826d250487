"""Identification of one gimbal axis: output error in the frequency domain."""
