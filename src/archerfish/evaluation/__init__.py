"""Evaluation: task × controller → shots → counts with intervals, paired on the same engagements and dispersion."""
