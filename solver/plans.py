"""Plans in time: what of the last plan is still to come."""

import numpy as np

from solver.arrays import FloatArray


def shifted(controls: FloatArray, elapsed_s: float, step_s: float) -> FloatArray:
    """Return controls (..., H, 2) as they stand `elapsed_s` later, a start for the next solve.

    Between steps they are interpolated; the last one goes on.
    """
    horizon = controls.shape[-2]
    times = np.minimum(np.arange(horizon) + max(elapsed_s, 0.0) / step_s, horizon - 1.0)
    before = times.astype(np.int64)
    after = np.minimum(before + 1, horizon - 1)
    share = (times - before)[:, None]
    blend = (1.0 - share) * controls[..., before, :] + share * controls[..., after, :]
    return np.asarray(blend)
