"""One run: faults in their order, what each came to, and what was found broken."""

import asyncio
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from time import monotonic
from typing import Any

from tests.chaos.ear import Unreported
from tests.chaos.journals import doctor
from tests.chaos.repertoire import FAULTS
from tests.chaos.schedule import Strike, schedule
from tests.chaos.team import OUTSIDE, Team, team
from tests.chaos.watch import Invariant, Violation
from tests.patience import PATIENCE_S

FAULT_S = 20.0
"""A fault with its recovery, or the end of a run, takes about so long; none is begun when less is
left."""


@dataclass(frozen=True)
class Row:
    """What became of one fault."""

    fault: str
    at_s: float
    """Since all robots first flew."""

    report: str
    """The words by which people were told, "" when nobody was."""

    flying_s: float
    """How long it took from the fault's end until all robots flew again."""

    violations: tuple[Violation, ...]


@dataclass
class Outcome:
    """What a run came to."""

    seed: int
    database: str
    disk: str
    rows: list[Row] = field(default_factory=list)
    late: tuple[Violation, ...] = ()
    """What only the end of the run brought to light."""

    checks: dict[str, int] = field(default_factory=dict)
    figures: dict[str, Any] = field(default_factory=dict)

    @property
    def violations(self) -> list[Violation]:
        """All of them."""
        return [one for row in self.rows for one in row.violations] + list(self.late)

    @property
    def passed(self) -> bool:
        """Whether faults struck and everything held."""
        return bool(self.rows) and not self.violations

    def shown(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {"passed": self.passed, **asdict(self)}


Show = Callable[[str, Sequence[Row]], None]
"""Told what is being done, and what is done."""


def database_of(seed: int) -> str:
    """Return where the journal of a run is kept when nobody says so: in both kinds by turns."""
    return "postgresql" if seed % 2 else "sqlite"


async def fly(
    seed: int,
    until_s: float,
    database: str,
    show: Show,
    strikes: Iterator[Strike] | None = None,
) -> Outcome:
    """Fly through the faults of a seed until a moment; return what was found.

    Args:
        seed: One seed, one schedule.
        until_s: On this machine's monotonic clock.
        database: `sqlite` or `postgresql`.
        show: Told what goes on.
        strikes: Other faults than the seed's; the run is over when they are.
    """
    chosen = schedule(seed, database, OUTSIDE) if strikes is None else strikes
    with TemporaryDirectory(prefix="falconer-chaos-") as folder:
        show("starting", ())
        async with team(Path(folder), seed, database) as made:
            outcome, began_s = Outcome(seed, database, made.disk.kind), monotonic()
            for strike in chosen:
                if monotonic() > until_s - FAULT_S:
                    break
                show(str(strike), outcome.rows)
                await asyncio.sleep(strike.after_s)
                outcome.rows.append(await struck(made, strike, began_s))
            show("closing", outcome.rows)
            await examine(made, outcome)
            return outcome


async def struck(made: Team, strike: Strike, began_s: float) -> Row:
    """Do one fault and wait until all robots fly again."""
    at_s, known, report = monotonic() - began_s, len(made.findings.violations), ""
    made.findings.looked(Invariant.REPORTED)
    try:
        report = await FAULTS[strike.kind](made, strike)
    except Unreported as error:
        made.findings.broken(Invariant.REPORTED, f"{strike} {at_s:.0f}", str(error))
    flying_s = await made.until_flying()
    for robot, link in made.links.items():
        made.watch.judge_orders(robot, (speed for _, speed in link.since(at_s + began_s)))
    found = tuple(made.findings.violations[known:])
    return Row(str(strike), round(at_s, 1), report, round(flying_s, 1), found)


async def examine(made: Team, outcome: Outcome) -> None:
    """Look at what only the end shows: comments, the journal, the browser."""
    known = len(made.findings.violations)
    await made.commenter.compare()
    assert made.visitor is not None
    await made.visitor.follows(PATIENCE_S)
    await made.commenter.compare_journal(made.database)
    made.findings.looked(Invariant.CHAIN)
    whole, words = await doctor(made.database)
    if not whole:
        made.findings.broken(Invariant.CHAIN, "chain", words)
    outcome.late = tuple(made.findings.violations[known:])
    outcome.checks = {one.value: made.findings.checks[one] for one in Invariant}
    watch = made.watch
    outcome.figures = {
        "setpoints": watch.setpoints,
        "snapshots": made.ear.snapshots,
        "least_distance_m": round(watch.nearest_m, 2),
        "held_after_s": round(max(watch.held_s, default=0.0), 2),
        "comments": len(made.commenter.acknowledged),
        "comments_refused": dict(Counter(made.commenter.refused)),
        "journal": words.splitlines()[0] if words else "",
        "load": round(os.getloadavg()[0], 1),
    }
