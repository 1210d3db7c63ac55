"""Stacks of symmetric 2x2 matrices, in closed form.

Team sizes go from two to thousands, so everything here works on whole stacks; for 2x2
matrices the closed forms are faster than LAPACK and easier to keep positive definite.
"""

import numpy as np

from solver.arrays import FloatArray


def inverse(matrices: FloatArray) -> FloatArray:
    """Return the inverses of symmetric positive definite matrices, shape (..., 2, 2)."""
    a, b, c = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    scale = 1.0 / (a * c - b * b)
    result = np.empty(matrices.shape)
    result[..., 0, 0] = c * scale
    result[..., 1, 1] = a * scale
    result[..., 0, 1] = result[..., 1, 0] = -b * scale
    return result


def clamped(matrices: FloatArray, lower: float, upper: float) -> FloatArray:
    """Return symmetric matrices with their eigenvalues brought into [lower, upper].

    Args:
        matrices: Shape (..., 2, 2); the upper triangle counts, entries finite.
        lower: Least eigenvalue of the result, and at least 1e-12 of the greatest one.
        upper: Greatest eigenvalue of the result.

    Returns:
        The same array where nothing had to change and it is symmetric, else a new one.
    """
    a, b, c = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 1]
    mean = 0.5 * (a + c)
    half = 0.5 * (a - c)
    radius = np.hypot(half, b)
    greatest = mean + radius
    least = mean - radius
    floor = np.maximum(lower, 1e-12 * np.minimum(greatest, upper))
    if (least >= floor).all() and (greatest <= upper).all():
        return matrices
    new_least = np.clip(least, floor, upper)
    new_greatest = np.clip(greatest, floor, upper)
    new_mean = 0.5 * (new_greatest + new_least)
    # Untouched pairs keep their shape exactly; a vanishing radius has no direction to keep.
    stretch = np.where(radius > 0.0, 0.5 * (new_greatest - new_least), 0.0)
    stretch /= np.where(radius > 0.0, radius, 1.0)
    result = np.empty(matrices.shape)
    result[..., 0, 0] = new_mean + stretch * half
    result[..., 1, 1] = new_mean - stretch * half
    result[..., 0, 1] = result[..., 1, 0] = stretch * b
    return result


def symmetric(matrices: FloatArray) -> FloatArray:
    """Return the symmetric parts, shape (..., d, d)."""
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))
