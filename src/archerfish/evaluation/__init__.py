"""Suites, trials, hit rates with intervals, the comparison with the paper, and the report."""
