"""Where a target will be, from what is seen of it: one predictor a file, for any law of aiming."""
