"""A run's figures, and its merit: the gate's fixed yardstick on what really happened."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from server.gate.merit import Merit, MeritPrices
from server.mission.setup import Compat, MissionSetup


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a run; less is better in all of them."""

    key: str
    head: str
    digits: int


TRACE = Figure("trace", "trace", 1)
SENSING = Figure("sensing_attacks", "sensing attacks", 1)
COMMUNICATION = Figure("communication_attacks", "comm. attacks", 1)
PATH = Figure("trajectory_length_m", "path (m)", 1)
ERROR = Figure("position_error_m", "error (m)", 3)
MERIT = Figure("merit", "merit", 1)
FIGURES = (TRACE, SENSING, COMMUNICATION, PATH, ERROR, MERIT)


def figures_of(result: Mapping[str, Any], setup: MissionSetup) -> dict[str, float]:
    """Return the figures of a run's JSON object.

    The trace is the authors' accounting in their scenarios, the team's elsewhere.
    """
    authors = setup.compat is Compat.AUTHORS
    trace = float(result["accumulated_trace_authors" if authors else "accumulated_trace"])
    figures = {
        TRACE.key: trace,
        SENSING.key: float(result["sensing_attacks"]),
        COMMUNICATION.key: float(result["communication_attacks"]),
        PATH.key: float(result["trajectory_length_m"]),
        ERROR.key: float(result["position_error_m"] or 0.0),
    }
    return figures | {MERIT.key: _merit(figures, setup, int(result["steps"]))}


def _merit(figures: Mapping[str, float], setup: MissionSetup, steps: int) -> float:
    """Return a run's merit as an accumulated trace: the gate's mean trace times the steps.

    Effort is that of flying the same paths at constant speed, the least there is; its price
    is so small that no more is needed.
    """
    seconds = steps * setup.tick_s
    happened = Merit(
        seconds=seconds,
        trace=setup.tick_s * figures[TRACE.key],
        sensing_hits=figures[SENSING.key],
        communication_hits=figures[COMMUNICATION.key],
        effort=len(setup.robots) * figures[PATH.key] ** 2 / seconds,
    )
    return steps * happened.per_second(MeritPrices.of(setup))
