"""Targets: how they move, and one table of the distributions that their parameters are drawn from."""
