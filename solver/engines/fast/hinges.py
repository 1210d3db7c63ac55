"""Squared hinges of a gap g that depends on one position: weight max(0, -g)^2."""

from solver.engines.fast.jit import inlined
from solver.engines.fast.layout import Table


@inlined
def add_hinge(
    work: Table,
    k: int,
    twice: float,
    gap: float,
    gx: float,
    gy: float,
    xx: float,
    xy: float,
    yy: float,
) -> None:
    """Add the derivatives of `twice / 2 * gap^2` to step k's gradient and diagonal block.

    `gx` to `yy` are the gap's own gradient and Hessian.
    """
    work.slope[k, 0] += twice * gap * gx
    work.slope[k, 1] += twice * gap * gy
    at = 2 * k
    cross = twice * (gx * gy + gap * xy)
    work.bend[at, at] += twice * (gx * gx + gap * xx)
    work.bend[at, at + 1] += cross
    work.bend[at + 1, at] += cross
    work.bend[at + 1, at + 1] += twice * (gy * gy + gap * yy)
