"""What becomes of a team on two sites: on a good link, without it, and on a poor one."""

import asyncio
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from time import monotonic
from typing import Any

from benchmarks.field.sites import AWAY, HERE, Field, Separation, field_of
from benchmarks.fleet import FleetError

LOOK_S = 0.02
STILL_M_S, MOVING_M_S = 0.1, 0.2
FLYING = "flying"
TEAM = (HERE, *AWAY)


@dataclass(frozen=True, slots=True)
class Plan:
    """What the link goes through. Seconds."""

    good_s: float = 3.0
    cut_s: float = 10.0
    poor_s: float = 12.0
    cuts: int = 1
    delay_s: float = 0.1
    loss: float = 0.05
    patience_s: float = 120.0
    """How long anything may take that must happen; a busy machine is not what is measured."""

    seed: int = 0


@dataclass(frozen=True, slots=True)
class Stretch:
    """A stretch of flight at the far site."""

    seconds: float
    setpoints: dict[int, int]
    """Heard, per robot."""

    longest_wait_s: dict[int, float]
    """Between two setpoints of a robot."""

    flying: dict[int, float]
    """Share of the time that a robot followed the planner."""

    refused: dict[int, int]
    ticks: int
    missed: int


@dataclass(frozen=True, slots=True)
class Outage:
    """What happened when the link was cut, in seconds from then; and after it was healed."""

    held_s: float
    """The last robot at the far site said that it holds, and stood."""

    lost_s: float
    """The planner had called all of them lost."""

    covered_s: float
    """Every target was given to a robot that can be reached."""

    fastest_m_s: float
    modes: list[str]
    """From when all held until the link was healed, at the far site."""

    ticks: int
    """Of the planner, meanwhile."""

    back_s: float
    """From the healing: all of them flew by fresh setpoints."""

    met_s: float
    """From the healing: the planner called all of them connected."""


@dataclass
class Figures:
    """All that was measured."""

    separation: Separation
    met_s: float = 0.0
    """From the first command until everybody flew."""

    good: Stretch | None = None
    outages: list[Outage] = field(default_factory=list)
    poor: Stretch | None = None
    recovered: Stretch | None = None
    carried: int = 0
    lost: int = 0
    tracked: list[str] = field(default_factory=list)
    ended: list[str] = field(default_factory=list)
    """Programs that did not last."""

    model_calls: int = 0

    def as_dict(self) -> dict[str, Any]:
        """Return everything as JSON takes it."""
        return asdict(self)


class _Flight:
    """Watches a flight over its phases."""

    def __init__(self, made: Field, plan: Plan) -> None:
        self._made, self._plan = made, plan

    async def until(self, condition: Callable[[dict[str, Any]], bool], what: str) -> float:
        """Wait for something to be so, looking at the newest snapshot; return how long it took."""
        began_s = monotonic()
        while True:
            snapshot = await self._made.snapshot()
            if snapshot and condition(snapshot):
                return monotonic() - began_s
            if monotonic() - began_s > self._plan.patience_s:
                links = [(robot["id"], robot["link"]) for robot in snapshot.get("robots", ())]
                logs = "\n".join(f"--- {one.name}\n{one.log[-3000:]}" for one in self._made.running)
                raise FleetError(f"{what}: {links} {self._made.robots()}\n{logs}")
            await asyncio.sleep(LOOK_S)

    def all_fly(self, robot_ids: tuple[int, ...] = AWAY) -> bool:
        """Tell whether robots follow the planner, by what is heard at the far site."""
        told = self._made.robots()
        return all(i in told and told[i]["mode"] == FLYING for i in robot_ids)

    async def stretch(self, seconds: float) -> Stretch:
        """Fly for so long."""
        before, began = await self._made.snapshot(), len(self._made.heard)
        first, began_s = self._made.robots(), monotonic()
        await asyncio.sleep(seconds)
        after, last = await self._made.snapshot(), self._made.robots()
        lines = [one["robots"] for one in self._made.heard[began:]]
        told = {i: [line[str(i)] for line in lines if str(i) in line] for i in AWAY}
        ticks = [one["loops"]["optimizer"] for one in (before, after)]
        return Stretch(
            seconds=round(monotonic() - began_s, 2),
            setpoints={i: last[i]["setpoints"] - first[i]["setpoints"] for i in AWAY},
            longest_wait_s={i: round(max(one["wait_s"] for one in told[i]), 3) for i in AWAY},
            flying={
                i: round(sum(one["mode"] == FLYING for one in told[i]) / len(told[i]), 4)
                for i in AWAY
            },
            refused={i: last[i]["refused"] - first[i]["refused"] for i in AWAY},
            ticks=ticks[1]["calls"] - ticks[0]["calls"],
            missed=ticks[1]["missed"] - ticks[0]["missed"],
        )

    async def last(self) -> dict[str, Any]:
        """Return the first snapshot that shows every target tracked, or that of the last moment.

        A track that nobody has updated for a moment, on a busy machine, is not tracked then.
        """
        until_s = monotonic() + self._plan.patience_s
        while True:
            snapshot = await self._made.snapshot()
            told = snapshot.get("targets", ())
            if told and ({t["status"] for t in told} == {"tracked"} or monotonic() > until_s):
                return snapshot
            await asyncio.sleep(LOOK_S)

    async def outage(self) -> Outage:
        """Cut the link, and heal it."""
        made = self._made
        before = await made.snapshot()
        cut_s = monotonic()
        made.weather.opened.clear()
        try:
            held, lost, covered = await asyncio.gather(
                self.until(lambda _: _all_stand(made.robots()), "holding"),
                self.until(lambda seen: _links(seen, AWAY) == {"lost"}, "called lost"),
                self.until(_all_covered, "covered"),
            )
            from_line = len(made.heard)
            await asyncio.sleep(max(0.0, cut_s + self._plan.cut_s - monotonic()))
            lines = made.heard[from_line:]
            # Here nobody noticed anything.
            await self.until(lambda seen: _links(seen, (HERE,)) == {"connected"}, "flying on here")
            after = await made.snapshot()
        finally:
            made.weather.opened.set()
        waiting = {i: told["setpoints"] for i, told in made.robots().items()}
        met = asyncio.create_task(
            self.until(lambda seen: _links(seen, TEAM) == {"connected"}, "connected again")
        )

        def flies(_: dict[str, Any]) -> bool:
            told = made.robots()
            fresh = all(told[i]["setpoints"] > waiting[i] for i in AWAY)
            return fresh and self.all_fly()

        back = await self.until(flies, "flying again")
        told = [line["robots"][str(i)] for line in lines for i in AWAY]
        return Outage(
            held_s=round(held, 2),
            lost_s=round(lost, 2),
            covered_s=round(covered, 2),
            fastest_m_s=round(max(one["speed_m_s"] for one in told), 2),
            modes=sorted({one["mode"] for one in told}),
            ticks=after["loops"]["optimizer"]["calls"] - before["loops"]["optimizer"]["calls"],
            back_s=round(back, 2),
            met_s=round(await met, 2),
        )


def _links(snapshot: dict[str, Any], robot_ids: tuple[int, ...]) -> set[str]:
    return {robot["link"] for robot in snapshot["robots"] if robot["id"] in robot_ids}


def _all_stand(told: dict[int, dict[str, Any]]) -> bool:
    return all(
        told[i]["mode"] == "holding" and told[i]["speed_m_s"] < STILL_M_S for i in AWAY if i in told
    )


def _all_covered(snapshot: dict[str, Any]) -> bool:
    """Tell whether every target is given to a robot that can be reached."""
    reached = {robot["id"] for robot in snapshot["robots"] if robot["link"] == "connected"}
    rows = snapshot["directives"]["assignment"]
    given = {target for robot, row in rows.items() if int(robot) in reached for target in row}
    lost_too = _links(snapshot, AWAY) == {"lost"}
    return lost_too and given == {target["id"] for target in snapshot["targets"]}


async def measure(plan: Plan, separation: Separation) -> Figures:
    """Fly through the plan; return the figures. Raises FleetError when something never happens."""
    figures, began_s = Figures(separation), monotonic()
    async with field_of(separation, plan.seed) as made:
        flight = _Flight(made, plan)

        def together(seen: dict[str, Any]) -> bool:
            return _links(seen, TEAM) == {"connected"} and flight.all_fly()

        await flight.until(together, "the first meeting")
        figures.met_s = round(monotonic() - began_s, 1)
        figures.good = await flight.stretch(plan.good_s)
        for _ in range(plan.cuts):
            figures.outages.append(await flight.outage())
            await flight.until(together, "together after the outage")
        made.weather.delay_s, made.weather.loss = plan.delay_s, plan.loss
        figures.poor = await flight.stretch(plan.poor_s)
        made.weather.delay_s, made.weather.loss = 0.0, 0.0
        await flight.until(together, "together after the poor link")
        figures.recovered = await flight.stretch(plan.good_s)
        last = await flight.last()
        figures.tracked = [target["status"] for target in last["targets"]]
        figures.model_calls = sum(last["loops"][one]["calls"] for one in ("task_llm", "action_llm"))
        figures.carried = sum(way.carried for way in made.ways)
        figures.lost = sum(way.lost for way in made.ways)
        figures.ended = [
            one.name for one in made.running if not one.alive or "Traceback" in one.log
        ]
        await made.http.post("/missions/m1/stop")
    return figures


def broken(figures: Figures, hold_within_s: float = 1.0, flying: float = 0.8) -> list[str]:
    """Return the promises that the figures break, in words.

    Args:
        figures: Of a flight.
        hold_within_s: Within what time a robot that hears nobody must stand.
        flying: Share of the time that every robot must follow the planner over a poor link.
    """
    found = [f"{name} did not last" for name in figures.ended]
    for outage in figures.outages:
        if outage.held_s > hold_within_s:
            found.append(f"held only after {outage.held_s:.2f} s")
        if outage.modes != ["holding"] or outage.fastest_m_s > MOVING_M_S:
            found.append(f"moved during the outage: {outage.modes}, {outage.fastest_m_s:.2f} m/s")
        if outage.ticks == 0:
            found.append("the planner stood still during the outage")
    if figures.poor is not None:
        for robot_id, share in figures.poor.flying.items():
            if share < flying:
                found.append(f"robot {robot_id} flew {100.0 * share:.0f} % of the poor link's time")
    if set(figures.tracked) != {"tracked"}:
        found.append(f"targets not tracked: {figures.tracked}")
    if figures.lost == 0:
        found.append("the link lost nothing")
    if figures.model_calls == 0:
        found.append("the model was never asked")
    return found
