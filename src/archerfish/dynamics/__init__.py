"""Gimbal, pellet and command limits as pure functions on arrays of any batch shape, NumPy's, JAX's or traced."""
