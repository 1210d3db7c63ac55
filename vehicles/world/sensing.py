"""What a robot measures: range and bearing with noise that grows with distance."""

from math import atan2, exp, pi, remainder, sqrt

from solver.observations import Sighting
from solver.problem import SensorModel
from solver.zones import Point
from vehicles.world.attacks import AUTHORS_FLOOR
from vehicles.world.setup import NoiseLaw

EXPONENT_LIMIT = 28.0


def deviations(model: SensorModel, law: NoiseLaw, distance_m: float) -> tuple[float, float]:
    """Return the standard deviations of range (metres) and bearing (radians) at a distance.

    With R = 1 / (peak exp(-shape d)): its square root under the sound law, R itself under the
    authors' (with their 1e-4 in d^2 and in 1/R). The exponent shape * d ends at 28, where a
    sighting has long been worthless, so that numbers stay finite.
    """
    if law is NoiseLaw.AUTHORS:
        distance = sqrt(distance_m * distance_m + AUTHORS_FLOOR)
        range_decay = exp(-min(model.range_shape * distance, EXPONENT_LIMIT))
        bearing_decay = exp(-min(model.bearing_shape * distance, EXPONENT_LIMIT))
        return (
            1.0 / (model.range_peak * range_decay + AUTHORS_FLOOR),
            1.0 / (model.bearing_peak * bearing_decay + AUTHORS_FLOOR),
        )
    return (
        sqrt(exp(min(model.range_shape * distance_m, EXPONENT_LIMIT)) / model.range_peak),
        sqrt(exp(min(model.bearing_shape * distance_m, EXPONENT_LIMIT)) / model.bearing_peak),
    )


def measure(
    model: SensorModel,
    law: NoiseLaw,
    robot: Point,
    target: tuple[int, Point],
    noise: tuple[float, float],
) -> Sighting:
    """Return one noisy sighting of a target.

    Args:
        model: Noise over distance.
        law: What R(d) is of the noise.
        robot: Where the robot is, metres.
        target: Id and true position of the target.
        noise: Two standard normal numbers, for range and bearing.

    Returns:
        Range and bearing (atan2 of north over east, wrapped to [-pi, pi]). The noise is
        additive and not cut off: very near a target a range can be slightly negative, which
        keeps it unbiased for a filter.
    """
    target_id, (x, y) = target
    east, north = x - robot[0], y - robot[1]
    distance = sqrt(east * east + north * north)
    range_deviation, bearing_deviation = deviations(model, law, distance)
    bearing = atan2(north, east) + bearing_deviation * noise[1]
    return Sighting(
        target_id=target_id,
        range_m=distance + range_deviation * noise[0],
        bearing_rad=remainder(bearing, 2.0 * pi),
    )
