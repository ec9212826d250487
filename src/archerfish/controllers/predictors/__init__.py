"""Predictors: where a target will be, from what is seen of it. One predictor a file; each serves any law of aiming."""
