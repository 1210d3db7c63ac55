"""Squared hinges of a gap g that depends on one position: weight max(0, -g)^2.

A hinge that is off shows neither slope nor curvature, and a Newton step that knows nothing of
it goes far too deep. Where a step failed, the hinges that it would have closed are taken for
closed (springs: weight g^2 on both sides) and the step is aimed anew (`guards.py`).
"""

from solver.engines.fast.jit import inlined
from solver.engines.fast.layout import Table


@inlined
def bears(work: Table, gap: float, change: float) -> bool:
    """Return whether a hinge counts: it is closed, or the change of the gap would close it."""
    if gap < 0.0:
        return True
    if gap + change < 0.0:
        work.springs += 1
        return True
    return False


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
