"""One module per physical thing: gimbal axes, pellets, muzzle, targets, command limits.

Pure functions on arrays of NumPy or JAX; states and parameters are NamedTuples; randomness enters as drawn arrays.
"""
