"""What the compiled routine is given: a problem as plain read-only arrays, by noun.

M robots, N targets, H steps, K zones or obstacles. Frame ENU, metres, seconds.
"""

from typing import Any, NamedTuple

from numba import types

from solver.arrays import BoolArray, FloatArray, IntArray


class Movement(NamedTuple):
    """Where the robots are and how they may move."""

    step: float
    double: bool
    positions: FloatArray
    """(M, 2)."""

    velocities: FloatArray
    """(M, 2)."""

    control_lower: FloatArray
    control_upper: FloatArray
    """(M, 2)."""

    speed: FloatArray
    """(M,)."""

    field_lower: FloatArray
    field_upper: FloatArray
    """(2,)."""

    field_weight: float
    effort: float
    """w2."""

    order: IntArray
    """(M,) the robots sorted by x."""


class Targets(NamedTuple):
    """What is to be seen, and by whom."""

    seen: IntArray
    """(E,) flat indices into (M, N) of who sees what, ascending."""

    means: FloatArray
    """(H, N, 2)."""

    priors: FloatArray
    """(N, 2, 2)."""

    growth: FloatArray
    """(H, N, 2, 2)."""

    range_peak: float
    range_shape: float
    bearing_peak: float
    bearing_shape: float
    floor: float
    """Added in square to the squared distance to a target, metres."""

    weight: float
    """w1."""

    prior_least: float
    prior_greatest: float
    """The eigenvalues of the priors are clamped to this interval."""


class Hazards(NamedTuple):
    """Zones of one kind."""

    centres: FloatArray
    """(K, 2)."""

    covariances: FloatArray
    """(K, 2, 2)."""

    margins: FloatArray
    quantiles: FloatArray
    severities: FloatArray
    """(K,)."""

    known: BoolArray
    """(M, K)."""

    weight: float
    """w3 or w4."""


class Safety(NamedTuple):
    """Separation, and the lengths that round the corners of the objective."""

    obstacles: FloatArray
    """(K, 2)."""

    distance: float
    weight: float
    zone_smoothing: float
    mate_smoothing: float


class Start(NamedTuple):
    """Where to start and when to stop."""

    previous: FloatArray
    """(M, H, 2) the warm start, or (0, 0, 0) where there is none."""

    replan: BoolArray
    """(M,)."""

    iterations: int
    """Newton steps per robot."""

    deadline: float
    """On the monotonic clock, seconds; infinity for none."""


def _array(dtype: Any, dimensions: int) -> Any:
    return types.Array(dtype, dimensions, "C", readonly=True)


def _tuple(kind: type, **fields: Any) -> Any:
    return types.NamedTuple([fields[name] for name in kind._fields], kind)  # type: ignore[attr-defined]


def request_types() -> tuple[Any, ...]:
    """Return the types of the six parts of a request."""
    number, whole, truth = types.float64, types.int64, types.boolean
    vector, matrix, stack = _array(number, 1), _array(number, 2), _array(number, 3)
    movement = _tuple(
        Movement,
        step=number,
        double=truth,
        positions=matrix,
        velocities=matrix,
        control_lower=matrix,
        control_upper=matrix,
        speed=vector,
        field_lower=vector,
        field_upper=vector,
        field_weight=number,
        effort=number,
        order=_array(whole, 1),
    )
    targets = _tuple(
        Targets,
        seen=_array(whole, 1),
        means=stack,
        priors=stack,
        growth=_array(number, 4),
        range_peak=number,
        range_shape=number,
        bearing_peak=number,
        bearing_shape=number,
        floor=number,
        weight=number,
        prior_least=number,
        prior_greatest=number,
    )
    hazards = _tuple(
        Hazards,
        centres=matrix,
        covariances=stack,
        margins=vector,
        quantiles=vector,
        severities=vector,
        known=_array(truth, 2),
        weight=number,
    )
    safety = _tuple(
        Safety,
        obstacles=matrix,
        distance=number,
        weight=number,
        zone_smoothing=number,
        mate_smoothing=number,
    )
    start = _tuple(
        Start, previous=stack, replan=_array(truth, 1), iterations=whole, deadline=number
    )
    return movement, targets, hazards, hazards, safety, start


def signature() -> Any:
    """Return the explicit signature of the compiled routine."""
    plans = types.Array(types.float64, 4, "C")
    answer = types.Tuple((plans, types.float64, types.int64, types.boolean))
    return answer(*request_types())
