"""What a hit by a zone would cost this mission, under the assignment in force."""

from collections import Counter

from server.mission.setup import MissionSetup
from solver.directives import Pairing
from solver.exposure import FREE, Prices, sight_loss


class PriceList:
    """Prices of exposure for the optimizer, remembered per assignment.

    A hit costs what the team will not know because of it: the trace that builds up while one
    of a target's watchers is out, summed over its watchers and averaged over the targets. A
    target with two watchers makes both of them bolder. More targets per robot do not make it
    shyer: it has as much more to gain. Prices are told in units of the weights
    the mission starts with: whoever raises the weight of a kind makes its exposure dearer in
    proportion, and whoever raises that of tracking makes both kinds cheaper beside it.
    """

    def __init__(self, setup: MissionSetup) -> None:
        self._setup = setup
        self._losses: dict[tuple[int, float], float] = {}
        self._assignment: frozenset[Pairing] | None = None
        self._prices = FREE

    def of(self, assignment: frozenset[Pairing]) -> Prices:
        """Return the prices under an assignment."""
        if assignment is not self._assignment:
            planner, weights = self._setup.planner, self._setup.weights
            watched = Counter(Counter(p.target_id for p in assignment).values())
            self._assignment = assignment
            self._prices = Prices(
                sensing=self._price(watched, planner.sensing_failure_s, weights.sensing),
                communication=self._price(
                    watched, planner.communication_failure_s, weights.communication
                ),
            )
        return self._prices

    def _price(self, watched: Counter[int], failure_s: float, weight: float) -> float:
        """Return one kind's price; `watched` counts targets by their number of watchers.

        A kind whose weight is 0 is not to be feared at all.
        """
        setup = self._setup
        if weight <= 0.0 or failure_s <= 0.0 or not watched:
            return 0.0
        loss = sum(
            watchers * targets * self._loss(watchers, failure_s)
            for watchers, targets in watched.items()
        )
        rate = 1.0 / setup.planner.attack_period_s
        return setup.weights.tracking / weight * rate * loss / watched.total()

    def _loss(self, watchers: int, failure_s: float) -> float:
        key = (watchers, failure_s)
        if key not in self._losses:
            setup = self._setup
            self._losses[key] = sight_loss(
                watchers, setup.filter, setup.sensor, setup.tick_s, failure_s
            )
        return self._losses[key]
