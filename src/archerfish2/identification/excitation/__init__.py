"""Excitation: what to command to an axis to identify it, and how well its logs will determine it."""
