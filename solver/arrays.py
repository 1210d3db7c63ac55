"""Array types of the vocabulary and how they are frozen."""

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]


def frozen(values: ArrayLike) -> FloatArray:
    """Return a read-only float64 copy, C-contiguous, so that a snapshot can be shared."""
    array = np.array(values, dtype=np.float64, order="C", copy=True)
    array.setflags(write=False)
    return array


def frozen_bool(values: ArrayLike) -> BoolArray:
    """Return a read-only boolean copy."""
    array = np.array(values, dtype=np.bool_, order="C", copy=True)
    array.setflags(write=False)
    return array
