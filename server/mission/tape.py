"""The tape: every input of the mission core in order, and what came out of each tick.

A mission on tape can be run again through a fresh core: same inputs, same setpoints and
directives, bit for bit on one machine and build. The plan of a solve that wall time may have ended
is an input too: nothing can compute it again, so the tape holds it.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from server.mission.setup import MissionSetup
from solver.arrays import FloatArray
from solver.directives import Directives, Proposal, Verdict
from solver.observations import Observation
from solver.problem import Problem, Rung, Solution
from solver.setpoints import Setpoint
from solver.snapshot import Snapshot

if TYPE_CHECKING:
    from server.mission.core import MissionCore


@dataclass(frozen=True, slots=True)
class Observed:
    """A fact reached the core."""

    observation: Observation
    kind: Literal["observed"] = "observed"


@dataclass(frozen=True, slots=True)
class Proposed:
    """A proposal reached the core."""

    proposal: Proposal
    refusal: tuple[str, ...] = ()
    """Why the gate or a person did not want it."""

    kind: Literal["proposed"] = "proposed"


@dataclass(frozen=True, slots=True)
class Began:
    """A tick began."""

    now_s: float
    kind: Literal["began"] = "began"


Rows = tuple[tuple[tuple[float, float], ...], ...]
"""Per robot and step two numbers."""


@dataclass(frozen=True, slots=True)
class LatePlan:
    """What a solve came to that wall time may have ended."""

    objective: float
    controls: Rows
    positions: Rows
    velocities: Rows

    @classmethod
    def of(cls, solution: Solution) -> "LatePlan":
        """Return a solution's plan with every bit."""
        return cls(
            solution.objective,
            _rows(solution.controls),
            _rows(solution.positions),
            _rows(solution.velocities),
        )


@dataclass(frozen=True, slots=True)
class Committed:
    """A tick ended: how its solve was stopped, and what left the core."""

    iterations: int
    rung: Rung
    setpoints: tuple[Setpoint, ...]
    directives: Directives
    plan: LatePlan | None = None
    """Of a solve that may not be computed again."""

    kind: Literal["committed"] = "committed"


Entry = Observed | Proposed | Began | Committed


class Recorder(Protocol):
    """Where the tape goes. Must not block: a full disk may cost the tape, never a tick."""

    def write(self, entry: Entry) -> None:
        """Take the next entry."""
        ...


class NoTape:
    """Keeps nothing."""

    def write(self, entry: Entry) -> None:
        """Let the entry go."""


class MemoryTape:
    """A tape in memory."""

    def __init__(self) -> None:
        self.entries: list[Entry] = []

    def write(self, entry: Entry) -> None:
        """Append the entry."""
        self.entries.append(entry)


class TapedCore:
    """A mission core that records what goes through it."""

    def __init__(self, core: "MissionCore", recorder: Recorder) -> None:
        self._core = core
        self._recorder = recorder

    @property
    def core(self) -> "MissionCore":
        """The core itself, to be read."""
        return self._core

    @property
    def snapshot(self) -> Snapshot:
        """The newest snapshot."""
        return self._core.snapshot

    def observe(self, observation: Observation) -> None:
        """Record and pass on."""
        self._recorder.write(Observed(observation))
        self._core.observe(observation)

    def propose(self, proposal: Proposal, refusal: tuple[str, ...] = ()) -> Verdict:
        """Record and pass on."""
        self._recorder.write(Proposed(proposal, refusal))
        return self._core.propose(proposal, refusal)

    def begin(self, now_s: float) -> Problem:
        """Record and pass on."""
        self._recorder.write(Began(now_s))
        return self._core.begin(now_s)

    def commit(self, solution: Solution) -> tuple[Setpoint, ...]:
        """Pass on and record what came out."""
        setpoints = self._core.commit(solution)
        self._recorder.write(
            Committed(
                iterations=solution.iterations,
                rung=solution.rung,
                setpoints=setpoints,
                directives=self._core.snapshot.directives,
                plan=LatePlan.of(solution) if solution.late else None,
            )
        )
        return setpoints


@dataclass(frozen=True, slots=True)
class Difference:
    """A tick whose replay did not give what the tape says."""

    tick: int
    recorded: Committed
    replayed: Committed


Resolve = Callable[[Problem, Committed], Solution]
"""Solves a replayed tick the way the recorded one was solved (see `Committed`)."""


def replay(
    setup: MissionSetup, entries: Iterable[Entry], resolve: Resolve
) -> Iterator[Difference | None]:
    """Run a tape through a fresh core; yield per tick what differs, None where nothing does.

    A tape that was cut off is replayed to its last whole tick. Raises ValueError when it
    commits a tick that it never began.
    """
    core = _fresh_core(setup)
    for recorded, replayed in _rerun(core, entries, resolve):
        same = recorded == replayed
        yield None if same else Difference(core.snapshot.tick, recorded, replayed)


def rewound(
    setup: MissionSetup, entries: Iterable[Entry], resolve: Resolve, until_s: float
) -> "MissionCore":
    """Return a core as it was when it had committed its last tick at or before a mission time.

    What reached it after that tick is left out. Raises ValueError as `replay` does.
    """
    core = _fresh_core(setup)
    for _ in _rerun(core, _until(entries, until_s), resolve):
        pass
    return core


def _rerun(
    core: "MissionCore", entries: Iterable[Entry], resolve: Resolve
) -> Iterator[tuple[Committed, Committed]]:
    """Put a tape through a core; yield what each tick gave then and what it gives now."""
    problem: Problem | None = None
    for entry in entries:
        match entry:
            case Observed():
                core.observe(entry.observation)
            case Proposed():
                core.propose(entry.proposal, entry.refusal)
            case Began():
                problem = core.begin(entry.now_s)
            case Committed():
                if problem is None:
                    raise ValueError("the tape commits a tick that it never began")
                setpoints = core.commit(resolve(problem, entry))
                yield (
                    entry,
                    Committed(
                        iterations=entry.iterations,
                        rung=entry.rung,
                        setpoints=setpoints,
                        directives=core.snapshot.directives,
                        plan=entry.plan,
                    ),
                )


def _until(entries: Iterable[Entry], until_s: float) -> Iterator[Entry]:
    """Yield the entries of whole ticks that began at or before a mission time."""
    tick: list[Entry] = []
    for entry in entries:
        if isinstance(entry, Began) and entry.now_s > until_s + 1e-9:
            return
        tick.append(entry)
        if isinstance(entry, Committed):
            yield from tick
            tick.clear()


def _rows(values: FloatArray) -> Rows:
    return tuple(tuple((float(x), float(y)) for x, y in row) for row in values)


def _fresh_core(setup: MissionSetup) -> "MissionCore":
    # Readers of recordings need the tape's words and not the mission's whole machinery.
    from server.mission.core import MissionCore

    return MissionCore(setup)
