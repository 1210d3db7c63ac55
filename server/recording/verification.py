"""Proof of a recording: its inputs through a fresh core must give its outputs, bit for bit.

Holds on the machine and build that wrote it; elsewhere the last digits of the optimizer may
differ.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from server.live.mission import ITERATIONS
from server.live.solving import Resolver
from server.mission.tape import Committed, Difference, Entry, replay
from server.recording.errors import RecordingError
from server.recording.reader import Recording
from solver import engines
from solver.planner import Planner

MAX_DIFFERENCES = 20
"""Kept with their words; more are only counted."""


@dataclass(slots=True)
class Verification:
    """What a replay came to."""

    ticks: int = 0
    different: int = 0
    late: int = 0
    """Ticks whose plan was taken from the tape: wall time may have ended their solve."""

    complete: bool = True
    """Whether the file was finished by its writer."""

    differences: list[str] = field(default_factory=list)

    @property
    def passed(self) -> bool:
        """Whether every tick gave the recorded setpoints and directives."""
        return self.ticks > 0 and self.different == 0


def verify_recording(recording: Recording, progress: Callable[[float], None]) -> Verification:
    """Replay a recording and compare every tick; `progress` is told mission seconds.

    Raises:
        RecordingError: The tape cannot be read or does not belong to its header.
        solver.engines.EngineUnavailable: The engine it was flown with cannot run here.
    """
    header = recording.header
    planner = Planner(engines.create(header.engine))
    found = Verification(complete=recording.complete)

    def entries() -> Iterator[Entry]:
        for entry in recording.entries():
            found.late += isinstance(entry, Committed) and entry.plan is not None
            yield entry

    try:
        for difference in replay(header.setup, entries(), Resolver(planner, ITERATIONS)):
            found.ticks += 1
            if difference is not None:
                found.different += 1
                if len(found.differences) < MAX_DIFFERENCES:
                    found.differences.append(_words(difference))
            progress(found.ticks * header.tick_s)
    except ValueError as error:
        raise RecordingError(f"{recording.path}: {error}") from None
    return found


def _words(difference: Difference) -> str:
    """Return one sentence on what differs in a tick."""
    recorded, replayed = difference.recorded, difference.replayed
    parts = []
    if recorded.setpoints != replayed.setpoints:
        parts.append(_setpoints(recorded, replayed))
    if recorded.directives != replayed.directives:
        parts.append("the directives differ")
    return f"tick {difference.tick}: {'; '.join(parts) or 'the outputs differ'}"


def _setpoints(recorded: Committed, replayed: Committed) -> str:
    ids = [setpoint.robot_id for setpoint in recorded.setpoints]
    if ids != [setpoint.robot_id for setpoint in replayed.setpoints]:
        return "other robots were commanded"
    worst = max(
        (
            (max(abs(a - b) for a, b in zip(one.velocity, two.velocity, strict=True)), one.robot_id)
            for one, two in zip(recorded.setpoints, replayed.setpoints, strict=True)
        ),
        default=(0.0, None),
    )
    return f"velocities differ by up to {worst[0]:.3g} m/s (robot {worst[1]})"
