"""Unit quaternions (w, x, y, z), over any leading axes.

A quaternion q turns body vectors into the frame it is given in: v_frame = R(q) v_body.
"""

import numpy as np

from solver.arrays import FloatArray

SMALL_RAD = 1e-8
"""Below this angle the limits of the series are used."""

IDENTITY: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the quaternion that turns by b, then by a; shapes (..., 4) broadcast."""
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    result = np.empty(b.shape if b.ndim >= a.ndim else a.shape)
    result[..., 0] = aw * bw - ax * bx - ay * by - az * bz
    result[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    result[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    result[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return result


def conjugate(q: FloatArray) -> FloatArray:
    """Return the opposite turn, shape (..., 4)."""
    opposite: FloatArray = q * np.array([1.0, -1.0, -1.0, -1.0])
    return opposite


def of_vector(turn: FloatArray) -> FloatArray:
    """Return the quaternions (..., 4) of rotation vectors (..., 3), rad."""
    angle = np.sqrt((turn * turn).sum(axis=-1))
    half = 0.5 * angle
    result = np.empty((*turn.shape[:-1], 4))
    result[..., 0] = np.cos(half)
    scale = np.where(angle > SMALL_RAD, np.sin(half) / np.maximum(angle, SMALL_RAD), 0.5)
    result[..., 1:] = scale[..., None] * turn
    return result


def vector_of(q: FloatArray) -> FloatArray:
    """Return the shortest rotation vectors (..., 3), rad, of unit quaternions (..., 4)."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.sqrt((q[..., 1:] * q[..., 1:]).sum(axis=-1, keepdims=True))
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.where(sine > SMALL_RAD, angle / np.maximum(sine, SMALL_RAD), 2.0)


def turned(q: FloatArray, vector: FloatArray) -> FloatArray:
    """Return R(q) v; shapes (..., 4) and (..., 3) broadcast."""
    w, axis = q[..., :1], q[..., 1:]
    twice = 2.0 * _cross(axis, vector)
    return vector + w * twice + _cross(axis, twice)


def about_up(angle: FloatArray) -> FloatArray:
    """Return the quaternions (..., 4) of turns about the vertical by (...) rad."""
    half = 0.5 * angle
    zero = np.zeros_like(half)
    return np.stack((np.cos(half), zero, zero, np.sin(half)), axis=-1)


def yaw_of(q: FloatArray) -> FloatArray:
    """Return the turn about the vertical, rad in (-pi, pi], shape (...)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    yaw: FloatArray = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return yaw


def matrix_of(q: FloatArray) -> FloatArray:
    """Return the rotation matrices (..., 3, 3)."""
    return np.swapaxes(turned(q[..., None, :], np.eye(3)), -1, -2)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a x b over the last axis; quicker than numpy's own for small arrays."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    first = ay * bz - az * by
    result = np.empty((*first.shape, 3))
    result[..., 0] = first
    result[..., 1] = az * bx - ax * bz
    result[..., 2] = ax * by - ay * bx
    return result
