"""Adapter: SIPPY (sippy-unipi) with its default horizons, by each of its methods for a state space."""

from functools import partial

from protocol import Case, Model, main
from sippy_unipi import system_identification

METHODS = ("N4SID", "MOESP", "CVA", "PARSIM-K")


def identify(case: Case, method: str) -> Model:
    """Identify by one method, with a feedthrough."""
    model = system_identification(
        case.output,
        case.inputs,
        method,
        tsample=case.sample_period_s,
        SS_fixed_order=case.order,
        SS_D_required=True,
    )
    return {"A": model.A, "B": model.B, "C": model.C, "D": model.D}


if __name__ == "__main__":
    main({method: partial(identify, method=method) for method in METHODS})
