"""Symmetric 2x2 matrices as three numbers (xx, xy, yy), for kernels."""

from math import sqrt

from solver.engines.fast.jit import inlined, kernel

Symmetric = tuple[float, float, float]


@inlined
def inverse(xx: float, xy: float, yy: float) -> Symmetric:
    """Return the inverse of a positive definite matrix."""
    scale = 1.0 / (xx * yy - xy * xy)
    return yy * scale, -xy * scale, xx * scale


@inlined
def inner(a0: float, a1: float, a2: float, b0: float, b1: float, b2: float) -> float:
    """Return tr(A B)."""
    return a0 * b0 + 2.0 * a1 * b1 + a2 * b2


@inlined
def sandwich(p0: float, p1: float, p2: float, s0: float, s1: float, s2: float) -> Symmetric:
    """Return P S P, both symmetric."""
    m00 = p0 * s0 + p1 * s1
    m01 = p0 * s1 + p1 * s2
    m10 = p1 * s0 + p2 * s1
    m11 = p1 * s1 + p2 * s2
    return m00 * p0 + m01 * p1, m00 * p1 + m01 * p2, m10 * p1 + m11 * p2


@inlined
def lifted(a: float, b: float, c: float, d: float, s0: float, s1: float, s2: float) -> Symmetric:
    """Return A S A' for A = [[a, b], [c, d]]."""
    m00 = a * s0 + b * s1
    m01 = a * s1 + b * s2
    m10 = c * s0 + d * s1
    m11 = c * s1 + d * s2
    return m00 * a + m01 * b, m00 * c + m01 * d, m10 * c + m11 * d


@kernel
def clamped(xx: float, xy: float, yy: float, least: float, most: float) -> Symmetric:
    """Return the matrix with its eigenvalues clamped to [least, most]."""
    mean = 0.5 * (xx + yy)
    half = 0.5 * (xx - yy)
    radius = sqrt(half * half + xy * xy)
    high = min(max(mean + radius, least), most)
    low = min(max(mean - radius, least), most)
    if radius <= 1e-300:
        return high, 0.0, high
    mean = 0.5 * (high + low)
    scale = 0.5 * (high - low) / radius
    return mean + scale * half, scale * xy, mean - scale * half
