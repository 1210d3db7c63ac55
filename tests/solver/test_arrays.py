"""What is shared cannot be changed."""

from collections.abc import Callable

import numpy as np
import pytest

from solver.arrays import BoolArray, FloatArray, frozen, frozen_bool


@pytest.mark.parametrize(("freeze", "kind"), [(frozen, np.float64), (frozen_bool, np.bool_)])
def test_a_frozen_array_is_a_contiguous_copy_that_nobody_writes_to(
    freeze: Callable[[object], FloatArray | BoolArray], kind: type
) -> None:
    source = np.array([[1, 0], [0, 1]], order="F")
    array = freeze(source)
    assert array.dtype == kind
    assert array.flags.c_contiguous
    assert not array.flags.writeable
    source[0, 0] = 0
    assert array[0, 0]
    again = freeze(array)
    assert not np.shares_memory(again, array)
