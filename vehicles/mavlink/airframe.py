"""How the simulated multirotor moves: a second-order response with limits, in local ENU."""

import math
from dataclasses import dataclass

from vehicles.mavlink.frames import Vector

GRAVITY_M_S2 = 9.80665
LONGEST_STEP_S = 0.01
"""Longer steps are taken as several."""


@dataclass(frozen=True, slots=True)
class AirframeSettings:
    """What the airframe and its inner loops can do."""

    frequency_rad_s: float = 3.0
    """Natural frequency of the position response."""

    damping: float = 1.0
    acceleration_m_s2: float = 6.0
    speed_m_s: float = 10.0
    climb_m_s: float = 3.0


class Airframe:
    """Position and velocity of a multirotor that chases a reference."""

    def __init__(self, settings: AirframeSettings, position: Vector) -> None:
        self.position = position
        self.velocity: Vector = (0.0, 0.0, 0.0)
        self.acceleration: Vector = (0.0, 0.0, 0.0)
        self._settings = settings

    @property
    def roll_rad(self) -> float:
        """Tilt to the south, which a nose to the east rolls right for."""
        return math.atan2(-self.acceleration[1], GRAVITY_M_S2)

    @property
    def pitch_rad(self) -> float:
        """Tilt against the east, nose up positive."""
        return math.atan2(-self.acceleration[0], GRAVITY_M_S2)

    def chase(self, place: Vector | None, velocity: Vector, dt_s: float) -> None:
        """Move for `dt_s` after a reference.

        Args:
            place: Where to be (m), moving at `velocity`; None to keep to the velocity alone.
            velocity: Velocity of the reference, m/s.
            dt_s: Time to pass, seconds.
        """
        steps = max(math.ceil(dt_s / LONGEST_STEP_S), 1)
        for _ in range(steps):
            self._step(place, velocity, dt_s / steps)
            if place is not None:
                x, y, z = (a + b * dt_s / steps for a, b in zip(place, velocity, strict=True))
                place = (x, y, z)

    def rest(self, height_m: float) -> None:
        """Stand on the ground."""
        self.position = (self.position[0], self.position[1], height_m)
        self.velocity = self.acceleration = (0.0, 0.0, 0.0)

    def _step(self, place: Vector | None, velocity: Vector, dt_s: float) -> None:
        omega, zeta = self._settings.frequency_rad_s, self._settings.damping
        pull = [0.0, 0.0, 0.0]
        if place is not None:
            pull = [omega * omega * (a - b) for a, b in zip(place, self.position, strict=True)]
        wanted = [
            p + 2.0 * zeta * omega * (a - b)
            for p, a, b in zip(pull, velocity, self.velocity, strict=True)
        ]
        self.acceleration = _shortened(wanted, self._settings.acceleration_m_s2)
        moved = [v + a * dt_s for v, a in zip(self.velocity, self.acceleration, strict=True)]
        level = _shortened([moved[0], moved[1], 0.0], self._settings.speed_m_s)
        climb = self._settings.climb_m_s
        self.velocity = (level[0], level[1], min(max(moved[2], -climb), climb))
        x, y, z = (p + v * dt_s for p, v in zip(self.position, self.velocity, strict=True))
        self.position = (x, y, z)


def _shortened(vector: list[float], longest: float) -> Vector:
    length = math.hypot(*vector)
    factor = longest / length if length > longest else 1.0
    return (vector[0] * factor, vector[1] * factor, vector[2] * factor)
