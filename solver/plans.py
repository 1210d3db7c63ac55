"""Plans in time: what of the last plan is still to come."""

import numpy as np

from solver.arrays import FloatArray


def shifted(controls: FloatArray, elapsed_s: float, step_s: float) -> FloatArray:
    """Return controls (..., H, 2) as they stand `elapsed_s` later, the last one repeated.

    Controls are constant over a step: less than a step later they are the same.
    """
    horizon = controls.shape[-2]
    moved = np.floor(np.arange(horizon) + max(elapsed_s, 0.0) / step_s + 1e-9).astype(int)
    return controls[..., np.minimum(moved, horizon - 1), :]
