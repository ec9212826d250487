"""Evaluation: a task and controllers give shots, shots give hit rates with intervals, and these are reported."""
