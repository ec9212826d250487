"""The policy's network: the paper's fully connected layers with ReLU, in NumPy or JAX."""

from typing import NamedTuple

from archerfish.arrays import Array, lift, namespace

OBSERVATION_CLIP = 10.0
"""A normalised observation is clipped here: a number never seen in training can't drive the network anywhere."""


class Layer(NamedTuple):
    """One affine layer."""

    weight: Array  # (inputs, outputs)
    bias: Array  # (outputs,)


class Normaliser(NamedTuple):
    """Mean and variance of the observations of a training."""

    mean: Array  # (n,)
    variance: Array  # (n,)
    count: Array  # of observations, ()


def normalise(normaliser: Normaliser, observation: Array) -> Array:
    """Shift and scale an observation to zero mean and unit variance, clipped; shape B + (n,)."""
    xp = namespace(observation)
    mean, variance = lift(normaliser.mean, observation), lift(normaliser.variance, observation)
    scaled = (observation - mean) / xp.sqrt(variance + 1e-8)
    return xp.clip(scaled, -OBSERVATION_CLIP, OBSERVATION_CLIP)


def forward(layers: tuple[Layer, ...], inputs: Array) -> Array:
    """Run a network with ReLU between its layers, shape B + (n,) → B + (outputs,)."""
    xp = namespace(inputs)
    if hasattr(xp, "network"):  # traced, where it stays one
        return xp.network(layers, inputs)
    for place, layer in enumerate(layers):
        inputs = xp.maximum(inputs, 0.0) if place else inputs
        inputs = inputs @ layer.weight
        inputs = inputs + lift(layer.bias, inputs)
    return inputs
