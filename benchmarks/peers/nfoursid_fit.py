"""Adapter: nfoursid. Its default of 2 block rows can't hold order 4, so: 10 as in its example, and 20."""

from functools import partial

import numpy as np
import pandas as pd
from nfoursid.nfoursid import NFourSID
from protocol import Case, Model, main


def identify(case: Case, block_rows: int) -> Model:
    """Identify by PO-MOESP and the state sequence."""
    inputs = [f"u{index}" for index in range(case.inputs.shape[1])]
    frame = pd.DataFrame(np.hstack([case.inputs, case.output]), columns=[*inputs, "y"])
    method = NFourSID(frame, output_columns=["y"], input_columns=inputs, num_block_rows=block_rows)
    method.subspace_identification()
    model, _ = method.system_identification(rank=case.order)
    return {"A": model.a, "B": model.b, "C": model.c, "D": model.d}


if __name__ == "__main__":
    main({f"{rows} block rows": partial(identify, block_rows=rows) for rows in (10, 20)})
