"""Adapter: ctrlsys (SLICOT): IB01AD and IB01BD for A and C, IB01CD for B and D by the simulation error.

It has no default for the block rows; 20 and 25 are tried, and 10 on short logs, which can't bear as many.
"""

from functools import partial

import ctrlsys
import numpy as np
from protocol import Case, Model, main


def identify(case: Case, block_rows: int) -> Model:
    """Identify by MOESP for A and by N4SID for the rest (SLICOT's combined method)."""
    n, (count, m) = case.order, case.inputs.shape
    _, factor, _, _, info = ctrlsys.ib01ad("M", "C", "N", "O", "N", "N", block_rows, m, 1, *_signals(case), 0.0, 0.0)
    _check("IB01AD", info)
    A, C, *_, info = ctrlsys.ib01bd("C", "A", "N", block_rows, n, m, 1, count, factor, 0.0)
    _check("IB01BD", info)
    given = A.copy(order="F"), np.zeros((n, m), order="F"), C.copy(order="F"), np.zeros((1, m), order="F")
    _, B, D, *_, info = ctrlsys.ib01cd("X", "C", "D", n, m, 1, *given, *_signals(case), 0.0)
    _check("IB01CD", info)
    return {"A": A, "B": B, "C": C, "D": D}


def _signals(case: Case) -> tuple[np.ndarray, np.ndarray]:
    """Return copies, since the routines work in place."""
    return np.array(case.inputs, order="F"), np.array(case.output, order="F")


def _check(routine: str, info: int) -> None:
    if info:
        raise RuntimeError(f"{routine} failed with info = {info}")


if __name__ == "__main__":
    main({f"{rows} block rows": partial(identify, block_rows=rows) for rows in (10, 20, 25)})
