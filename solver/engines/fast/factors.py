"""Small dense linear algebra without allocation: n <= 2H, matrices in scratch."""

from math import hypot, sqrt

from solver.arrays import FloatArray, IntArray
from solver.engines.fast.jit import kernel

_PIVOT = 1e-9
"""Least pivot that counts as positive, relative to the largest diagonal entry."""

_FLOOR = 1e-7
"""Least curvature kept, relative to the largest."""

_PARLETT = 0.6403882
"""(1 + sqrt(17)) / 8: a diagonal pivot is taken above this part of the largest entry."""


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
def factor_indefinite(matrix: FloatArray, size: int, order: IntArray, pairs: IntArray) -> None:
    """Factor the leading block as P L D L' P' in place, by complete pivoting.

    Both triangles are read. D has blocks of one and (pairs[k] = 1 at the first row of) two;
    it stays on the diagonal and below it, L in the rest of the lower triangle. order[k] is
    the row of the original that came to stand at k. Complete pivoting (Bunch and Parlett,
    1971) keeps the entries of L below 2.8, so that the signs of D tell the curvature.
    """
    for row in range(size):
        order[row] = row
        pairs[row] = 0
    k = 0
    while k < size:
        peak, corner = k, 0.0
        above, below, largest = k, k, 0.0
        for row in range(k, size):
            if abs(matrix[row, row]) > corner:
                peak, corner = row, abs(matrix[row, row])
            for column in range(k, row):
                if abs(matrix[row, column]) > largest:
                    below, above, largest = row, column, abs(matrix[row, column])
        if corner >= _PARLETT * largest:
            _swap(matrix, size, order, k, peak)
            _eliminate(matrix, size, k)
            k += 1
        else:
            _swap(matrix, size, order, k, above)
            _swap(matrix, size, order, k + 1, below)
            pairs[k] = 1
            _eliminate_pair(matrix, size, k)
            k += 2


@kernel
def _swap(matrix: FloatArray, size: int, order: IntArray, first: int, second: int) -> None:
    """Exchange two rows and the same columns."""
    if first == second:
        return
    order[first], order[second] = order[second], order[first]
    for at in range(size):
        matrix[first, at], matrix[second, at] = matrix[second, at], matrix[first, at]
    for at in range(size):
        matrix[at, first], matrix[at, second] = matrix[at, second], matrix[at, first]


@kernel
def _eliminate(matrix: FloatArray, size: int, k: int) -> None:
    pivot = matrix[k, k]
    if pivot == 0.0:
        return
    for row in range(k + 1, size):
        factor = matrix[row, k] / pivot
        for column in range(k + 1, size):
            matrix[row, column] -= factor * matrix[k, column]
    for row in range(k + 1, size):
        matrix[row, k] /= pivot


@kernel
def _eliminate_pair(matrix: FloatArray, size: int, k: int) -> None:
    a, b, c = matrix[k, k], matrix[k + 1, k], matrix[k + 1, k + 1]
    scale = 1.0 / (a * c - b * b)
    for row in range(k + 2, size):
        first = scale * (c * matrix[row, k] - b * matrix[row, k + 1])
        second = scale * (a * matrix[row, k + 1] - b * matrix[row, k])
        for column in range(k + 2, size):
            matrix[row, column] -= first * matrix[k, column] + second * matrix[k + 1, column]
        matrix[row, k], matrix[row, k + 1] = first, second


@kernel
def solve_absolute(
    matrix: FloatArray,
    size: int,
    order: IntArray,
    pairs: IntArray,
    vector: FloatArray,
    work: FloatArray,
) -> None:
    """Solve P L |D| L' P' x = b in place: |D| with absolute eigenvalues, clamped from below."""
    largest = 0.0
    for k in range(size):
        largest = max(largest, abs(matrix[k, k]))
        if pairs[k]:
            largest = max(largest, abs(matrix[k + 1, k]))
    floor = max(_FLOOR * largest, 1e-300)
    for row in range(size):
        work[row] = vector[order[row]]
    k = 0
    while k < size:
        block = 2 if pairs[k] else 1
        for row in range(k + block, size):
            work[row] -= matrix[row, k] * work[k]
            if block == 2:
                work[row] -= matrix[row, k + 1] * work[k + 1]
        k += block
    k = 0
    while k < size:
        if pairs[k]:
            _solve_pair(matrix[k, k], matrix[k + 1, k], matrix[k + 1, k + 1], floor, work, k)
            k += 2
        else:
            work[k] /= max(abs(matrix[k, k]), floor)
            k += 1
    for k in range(size - 1, -1, -1):
        # The entry below the first row of a pair belongs to D.
        for row in range(k + 1 + pairs[k], size):
            work[k] -= matrix[row, k] * work[row]
    for row in range(size):
        vector[order[row]] = work[row]


@kernel
def _solve_pair(a: float, b: float, c: float, floor: float, work: FloatArray, k: int) -> None:
    """Solve with [[a, b], [b, c]] by its eigenvalues, absolute and clamped."""
    mean, half = 0.5 * (a + c), 0.5 * (a - c)
    radius = hypot(half, b)
    high, low = max(abs(mean + radius), floor), max(abs(mean - radius), floor)
    # Along the eigenvectors: the projectors are (1 +- N) / 2 with N = (A - mean) / radius.
    x, y = work[k], work[k + 1]
    nx, ny = (half * x + b * y) / radius, (b * x - half * y) / radius
    work[k] = 0.5 * ((x + nx) / high + (x - nx) / low)
    work[k + 1] = 0.5 * ((y + ny) / high + (y - ny) / low)
