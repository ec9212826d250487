"""Identification of camera and link: time offset, latencies, noise and misses, from a sweep and from steps."""
