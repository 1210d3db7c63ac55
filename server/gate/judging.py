"""When worse is clearly worse."""

from server.gate.decisions import Changes, GateVerdict, Judgement
from server.gate.merit import MeritPrices
from server.gate.rollout import Forecast
from server.mission.setup import GateMode
from solver.directives import Source

LEAST_MARGIN_M2 = 1e-3
"""Differences below this mean nothing, however good the merit in force is."""


class Judge:
    """Owner of what the gate has let pass: losses add up until they are made good.

    A proposal may be worse by the margin. So that many small losses in a row do not lead
    anywhere, what has been let pass is remembered as a debt: the next proposal's loss counts on
    top of it, an improvement pays it back, and people, who may do as they like, end it.
    """

    def __init__(self, mode: GateMode, prices: MeritPrices, share: float) -> None:
        self._mode = mode
        self._prices = prices
        self._share = share
        self._debt = 0.0

    def rule(self, changes: Changes, forecast: Forecast | None) -> GateVerdict:
        """Return the verdict on what is asked for, given what is predicted of it."""
        if not changes:
            reason = "It asks for what is in force."
            return GateVerdict(self._mode, Judgement.UNCHANGED, reason)
        if forecast is None:
            return GateVerdict(self._mode, Judgement.UNJUDGED, "Nothing was predicted of it.")
        in_force = forecast.in_force.per_second(self._prices)
        proposed = forecast.proposed.per_second(self._prices)
        difference = proposed - in_force
        margin = max(LEAST_MARGIN_M2, self._share * in_force)
        if difference <= 0.0:
            judgement, words = Judgement.BETTER, "no worse"
        elif difference + self._debt <= margin:
            judgement, words = Judgement.NOT_WORSE, "not clearly worse"
        else:
            judgement, words = Judgement.CLEARLY_WORSE, "clearly worse"
        debt = f" after {self._debt:.4f} let pass before" if self._debt > 0.0 else ""
        return GateVerdict(
            mode=self._mode,
            judgement=judgement,
            reason=(
                f"Predicted {words}: merit {proposed:.4f} m² against {in_force:.4f} m² over "
                f"{forecast.horizon_s:g} s, margin {margin:.4f}{debt}."
            ),
            horizon_s=forecast.horizon_s,
            in_force=forecast.in_force,
            proposed=forecast.proposed,
            difference=difference,
            margin=margin,
        )

    def adopted(self, source: Source, verdict: GateVerdict | None) -> None:
        """Take note that a proposal went into force."""
        if source is Source.OPERATOR:
            self._debt = 0.0
        elif verdict is not None and verdict.difference is not None:
            self._debt = max(0.0, self._debt + verdict.difference)
