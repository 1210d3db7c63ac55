"""Which two of a team to look at."""

from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from solver.arrays import FloatArray, IntArray

_ALL = 64
"""Up to this team size all pairs are looked at, beyond it a tree finds the near ones."""


@lru_cache(maxsize=_ALL + 1)
def _all_pairs(count: int) -> tuple[IntArray, IntArray]:
    first, second = np.triu_indices(count, 1)
    first.setflags(write=False)
    second.setflags(write=False)
    return first, second


def near_pairs(positions: FloatArray, reach: float) -> tuple[IntArray, IntArray]:
    """Return the pairs i < l of robots that may be nearer than `reach`, in order.

    Args:
        positions: (M, 2).
        reach: Metres.

    Returns:
        Index arrays i and l; small teams get all their pairs.
    """
    if len(positions) <= _ALL:
        return _all_pairs(len(positions))
    pairs = cKDTree(positions).query_pairs(reach, output_type="ndarray")
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    return pairs[:, 0], pairs[:, 1]
