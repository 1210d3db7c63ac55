"""The tape: every input of the mission core in order, and what came out of each tick.

A mission on tape can be run again through a fresh core: same inputs, same setpoints and
directives, bit for bit on one machine and build. How a live solve ended is an input too,
since wall time decides it: the replay stops at the same iteration.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Literal, Protocol

from server.mission.core import MissionCore
from server.mission.setup import MissionSetup
from solver.directives import Directives, Proposal, Verdict
from solver.observations import Observation
from solver.problem import Problem, Rung, Solution
from solver.setpoints import Setpoint
from solver.snapshot import Snapshot


@dataclass(frozen=True, slots=True)
class Observed:
    """A fact reached the core."""

    observation: Observation
    kind: Literal["observed"] = "observed"


@dataclass(frozen=True, slots=True)
class Proposed:
    """A proposal reached the core."""

    proposal: Proposal
    kind: Literal["proposed"] = "proposed"


@dataclass(frozen=True, slots=True)
class Began:
    """A tick began."""

    now_s: float
    kind: Literal["began"] = "began"


@dataclass(frozen=True, slots=True)
class Committed:
    """A tick ended: how its solve was stopped, and what left the core."""

    iterations: int
    rung: Rung
    setpoints: tuple[Setpoint, ...]
    directives: Directives
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

    def __init__(self, core: MissionCore, recorder: Recorder) -> None:
        self._core = core
        self._recorder = recorder

    @property
    def core(self) -> MissionCore:
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

    def propose(self, proposal: Proposal) -> Verdict:
        """Record and pass on."""
        self._recorder.write(Proposed(proposal))
        return self._core.propose(proposal)

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

    A tape that was cut off is replayed to its last whole tick.
    """
    core = MissionCore(setup)
    problem: Problem | None = None
    for entry in entries:
        match entry:
            case Observed():
                core.observe(entry.observation)
            case Proposed():
                core.propose(entry.proposal)
            case Began():
                problem = core.begin(entry.now_s)
            case Committed():
                if problem is None:
                    raise ValueError("the tape commits a tick that it never began")
                setpoints = core.commit(resolve(problem, entry))
                again = Committed(
                    iterations=entry.iterations,
                    rung=entry.rung,
                    setpoints=setpoints,
                    directives=core.snapshot.directives,
                )
                same = again == entry
                yield None if same else Difference(core.snapshot.tick, entry, again)
