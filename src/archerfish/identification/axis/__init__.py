"""Identification of a gimbal axis from recordings: poles, delay, numerators, and how sure they are."""
