"""Small dense linear algebra without allocation: n <= 2H, matrices in scratch."""

from math import sqrt

from solver.arrays import FloatArray
from solver.engines.fast.jit import kernel

_PIVOT = 1e-9
"""Least pivot that counts as positive, relative to the largest diagonal entry."""

_FLOOR = 1e-7
"""Least eigenvalue kept, relative to the largest."""

_SWEEPS = 12


@kernel
def cholesky(matrix: FloatArray, size: int) -> bool:
    """Factor the leading block in place (lower triangle); return False if it is not positive."""
    largest = 0.0
    for row in range(size):
        largest = max(largest, abs(matrix[row, row]))
    for column in range(size):
        pivot = matrix[column, column]
        for k in range(column):
            pivot -= matrix[column, k] * matrix[column, k]
        if not pivot > _PIVOT * largest:
            return False
        pivot = sqrt(pivot)
        matrix[column, column] = pivot
        for row in range(column + 1, size):
            value = matrix[row, column]
            for k in range(column):
                value -= matrix[row, k] * matrix[column, k]
            matrix[row, column] = value / pivot
    return True


@kernel
def substitute(factor: FloatArray, size: int, vector: FloatArray) -> None:
    """Solve L L' x = b in place."""
    for row in range(size):
        value = vector[row]
        for k in range(row):
            value -= factor[row, k] * vector[k]
        vector[row] = value / factor[row, row]
    for row in range(size - 1, -1, -1):
        value = vector[row]
        for k in range(row + 1, size):
            value -= factor[k, row] * vector[k]
        vector[row] = value / factor[row, row]


@kernel
def diagonalise(matrix: FloatArray, size: int, basis: FloatArray) -> None:
    """Cyclic Jacobi: eigenvalues to the diagonal, eigenvectors to the columns of basis."""
    for row in range(size):
        for column in range(size):
            basis[row, column] = 1.0 if row == column else 0.0
    for _ in range(_SWEEPS):
        off = scale = 0.0
        for row in range(size):
            scale += matrix[row, row] * matrix[row, row]
            for column in range(row):
                off += matrix[row, column] * matrix[row, column]
        if off <= 1e-16 * scale:
            return
        for row in range(1, size):
            for column in range(row):
                _rotate(matrix, size, column, row, basis)


@kernel
def _rotate(matrix: FloatArray, size: int, p: int, q: int, basis: FloatArray) -> None:
    entry = matrix[q, p]
    if entry == 0.0:
        return
    theta = 0.5 * (matrix[q, q] - matrix[p, p]) / entry
    t = 1.0 / (abs(theta) + sqrt(theta * theta + 1.0))
    if theta < 0.0:
        t = -t
    c = 1.0 / sqrt(t * t + 1.0)
    s = t * c
    for k in range(size):
        first, second = matrix[k, p], matrix[k, q]
        matrix[k, p] = c * first - s * second
        matrix[k, q] = s * first + c * second
    for k in range(size):
        first, second = matrix[p, k], matrix[q, k]
        matrix[p, k] = c * first - s * second
        matrix[q, k] = s * first + c * second
    for k in range(size):
        first, second = basis[k, p], basis[k, q]
        basis[k, p] = c * first - s * second
        basis[k, q] = s * first + c * second


@kernel
def solve_absolute(
    matrix: FloatArray, size: int, basis: FloatArray, vector: FloatArray, work: FloatArray
) -> None:
    """Solve |A| x = b in place, |A| with absolute eigenvalues clamped from below."""
    diagonalise(matrix, size, basis)
    largest = 0.0
    for at in range(size):
        largest = max(largest, abs(matrix[at, at]))
    floor = max(_FLOOR * largest, 1e-300)
    for at in range(size):
        value = 0.0
        for row in range(size):
            value += basis[row, at] * vector[row]
        work[at] = value / max(abs(matrix[at, at]), floor)
    for row in range(size):
        value = 0.0
        for at in range(size):
            value += basis[row, at] * work[at]
        vector[row] = value
