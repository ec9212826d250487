"""One step of an ordinary differential equation, for the models that have no closed form."""

from collections.abc import Callable

from archerfish.dynamics.array_namespace import Array


def runge_kutta_4(slope: Callable[[Array], Array], state: Array, stride: Array) -> Array:
    """Advance an autonomous differential equation by one classical Runge–Kutta step.

    Args:
      slope: derivative of a state, shape preserved.
      state: any shape.
      stride: step of the independent variable, broadcast against the state.
    """
    k1 = slope(state)
    k2 = slope(state + 0.5 * stride * k1)
    k3 = slope(state + 0.5 * stride * k2)
    k4 = slope(state + stride * k3)
    return state + stride / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
