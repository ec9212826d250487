"""Which pole of one plant stands for which of another: the pairing with the least sum of distances."""

import numpy as np
from numpy.typing import NDArray

Poles = NDArray[np.complex128]


def nearest_poles(poles: Poles, others: Poles) -> NDArray[np.intp]:
    """Return for each pole the index of the one that is paired with it, shape (n,).

    Args:
      poles: shape (n,).
      others: as many, shape (n,).
    """
    distances = np.abs(poles[:, None] - others)
    nearest = distances.argmin(axis=1)
    # Where no two poles have the same nearest one, no other pairing has a smaller sum.
    return nearest if len(set(nearest.tolist())) == len(nearest) else _least_sum(distances.tolist())


def _least_sum(costs: list[list[float]]) -> NDArray[np.intp]:
    """Return the column of each row in the assignment of least cost (Kuhn and Munkres, with shortest paths).

    SciPy's `linear_sum_assignment` does the same, but takes longer to import than all pairings of an axis take.
    """
    count = len(costs)
    row_price, column_price = [0.0] * count, [0.0] * (count + 1)
    owner = [-1] * (count + 1)  # row of each column; the column beside the last is where a new row enters
    for row in range(count):
        owner[count], column = row, count
        distance, before, visited = [np.inf] * count, [count] * count, [False] * (count + 1)
        while owner[column] >= 0:
            visited[column], here = True, owner[column]
            for other in range(count):
                step = costs[here][other] - row_price[here] - column_price[other]
                if not visited[other] and step < distance[other]:
                    distance[other], before[other] = step, column
            following = min((each for each in range(count) if not visited[each]), key=distance.__getitem__)
            change = distance[following]
            for other in range(count + 1):
                if visited[other]:
                    row_price[owner[other]] += change
                    column_price[other] -= change
                elif other < count:
                    distance[other] -= change
            column = following
        while column != count:
            owner[column] = owner[before[column]]
            column = before[column]
    found = np.empty(count, np.intp)
    found[owner[:count]] = np.arange(count)
    return found
