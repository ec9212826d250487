"""Adapter: jax-sysid on scaled signals: with the settings of its introduction, and with more from four random starts.

The introduction's ridge penalty of 0.01 pulls lightly damped poles inwards, so the other variants leave next to none of
it and begin with Adam, as the package's introduction does for recurrent networks; they fit better and take longer.
"""

from functools import partial

import numpy as np
from jax_sysid.models import LinearModel
from jax_sysid.utils import standard_scale
from protocol import Case, Model, main

INTRODUCTION = {"rho_x0": 1e-3, "rho_th": 1e-2, "adam_epochs": 0}
THOROUGH = {"rho_x0": 1e-8, "rho_th": 1e-8, "adam_epochs": 1000}
SEEDS = range(4)


def identify(case: Case, seed: int, rho_x0: float, rho_th: float, adam_epochs: int) -> Model:
    """Identify by the simulation error."""
    output, _, output_gain = standard_scale(case.output)
    inputs, _, input_gain = standard_scale(case.inputs)
    model = LinearModel(case.order, 1, inputs.shape[1], feedthrough=True, seed=seed)
    model.loss(rho_x0=rho_x0, rho_th=rho_th)
    model.optimization(adam_epochs=adam_epochs, lbfgs_epochs=1000, iprint=-1)
    model.fit(output, inputs)
    A, B, C, D = (np.asarray(matrix) for matrix in model.ssdata())
    return {"A": A, "B": B * input_gain, "C": C / output_gain, "D": D * input_gain / output_gain}


if __name__ == "__main__":
    introduction = {"introduction": partial(identify, seed=0, **INTRODUCTION)}
    main(introduction | {f"seed {seed}": partial(identify, seed=seed, **THOROUGH) for seed in SEEDS})
