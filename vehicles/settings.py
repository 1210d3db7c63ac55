"""How agents and simulated worlds are run. Read by whoever only says so, too."""

from dataclasses import dataclass, field

from solver.problem import Budget
from vehicles.world.setup import WorldSetup


@dataclass(frozen=True, slots=True)
class AgentSettings:
    """How an agent behaves. Seconds."""

    planner_silent_s: float = 0.5
    """Without a heartbeat for longer there is no planner."""

    autonomous_s: float = 0.0
    """How long it flies alone when there is no planner; 0 holds at once."""

    onboard_ttl_s: float = 0.5
    """Life time of a plan made on board."""

    onboard_budget: Budget = field(default_factory=lambda: Budget(deadline_s=0.02))
    plan_wait_s: float = 0.05
    """How long a step waits for a plan on board."""

    health_period_s: float = 1.0
    stale_state_s: float = 0.5
    """An older state of the body is not told."""

    duplicate_wait_s: float = 2.0
    """How long a token left by an earlier run may take to disappear."""

    conflict_s: float = 2.0
    """It holds for so long after another robot spoke under its id."""

    max_events: int = 1000


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """How a world is run."""

    seed: int = 0
    tick_s: float = 0.1
    agent: AgentSettings = field(default_factory=AgentSettings)
    external: tuple[int, ...] = ()
    """Robots of the world that are flown elsewhere; the world only senses for them."""


def check_external(setup: WorldSetup, external: tuple[int, ...]) -> None:
    """Raise ValueError when an external robot is none of the world's."""
    known = [robot.id for robot in setup.robots]
    for robot_id in external:
        if robot_id not in known:
            listed = ", ".join(map(str, known))
            raise ValueError(f"external robot {robot_id}: the world's robots are {listed}")
