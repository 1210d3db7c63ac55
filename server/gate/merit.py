"""The fixed yardstick of the gate: what a stretch of mission is worth, whatever the weights.

The merit of a window of T seconds is a mean trace, in square metres, less being better:

    merit = ( integral of sum_j tr P_j dt  +  k_s * hits_s  +  k_c * hits_c  +  k_u * effort ) / T

Hits are expected ones in a prediction and counted ones afterwards; effort is the integral of
the sum of squared speeds. The prices k belong to the scenario (DESIGN "the gate").
"""

from dataclasses import dataclass
from typing import Self

from server.mission.setup import MissionSetup
from solver.exposure import sight_loss

SENSING_FAILURE_S = 1.2
COMMUNICATION_FAILURE_S = 1.9
"""How long a failure lasts where the planner is told not to price it."""


@dataclass(frozen=True, slots=True)
class MeritPrices:
    """What counts beside the trace."""

    sensing: float
    """One sensing hit, m^2 s."""

    communication: float
    """One communication hit, m^2 s."""

    effort: float
    """One m^2/s of effort (squared speed times time), m^2 s."""

    @classmethod
    def of(cls, setup: MissionSetup) -> Self:
        """Return a mission's prices.

        Where the scenario names none, a hit costs what the team will not know because of it:
        the trace that builds up over the robot's share N / M of the targets while their one
        watcher is out. It depends on nothing that a proposal may change.
        """
        merit, planner = setup.merit, setup.planner
        sensing, communication = merit.sensing_price, merit.communication_price
        if sensing is None:
            sensing = _hit_price(setup, planner.sensing_failure_s or SENSING_FAILURE_S)
        if communication is None:
            failure_s = planner.communication_failure_s or COMMUNICATION_FAILURE_S
            communication = _hit_price(setup, failure_s)
        return cls(sensing, communication, merit.effort_price)


@dataclass(frozen=True, slots=True)
class Merit:
    """What a window held, by its parts."""

    seconds: float
    trace: float
    """Integral of the sum over targets of tr P, m^2 s."""

    sensing_hits: float
    communication_hits: float
    effort: float
    """Integral of the sum over robots of the squared speed, m^2/s."""

    def per_second(self, prices: MeritPrices) -> float:
        """Return the merit, m^2; less is better."""
        if self.seconds <= 0.0:
            return 0.0
        total = (
            self.trace
            + prices.sensing * self.sensing_hits
            + prices.communication * self.communication_hits
            + prices.effort * self.effort
        )
        return total / self.seconds


def _hit_price(setup: MissionSetup, failure_s: float) -> float:
    loss = sight_loss(1, setup.filter, setup.sensor, setup.tick_s, failure_s)
    return loss * len(setup.targets) / max(1, len(setup.robots))
