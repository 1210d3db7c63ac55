"""Which fault strikes when: a schedule that its seed determines."""

import random
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from llm.mock.behaviours import Mode

GARBAGE = (
    Mode.GARBAGE,
    Mode.NOT_JSON,
    Mode.EMPTY,
    Mode.NAN,
    Mode.OVER_CAPACITY,
    Mode.OUT_OF_BOUNDS,
    Mode.WRONG_LENGTH,
    Mode.UNKNOWN_IDS,
    Mode.FAIL_500,
    Mode.HUGE,
)
LONGEST_GAP_S = 1.5


class Kind(StrEnum):
    """What is broken."""

    KILL_VEHICLE = "vehicle killed"
    STOP_VEHICLE = "vehicle stopped"
    KILL_PLANNER = "planner killed"
    STOP_PLANNER = "planner stopped"
    SLOW_PLANNER = "planner slowed down"
    KILL_SERVER = "server killed"
    KILL_ROUTER = "router killed"
    STOP_ROUTER = "router stopped"
    CUT_NETWORK = "network cut"
    LOSE_MAVLINK = "MAVLink lost"
    GARBLE_MAVLINK = "garbage on MAVLink"
    GARBLE_BUS = "garbage on the bus"
    FLOOD_BUS = "flood on the bus"
    FLOOD_API = "flood of requests"
    GARBLE_LLM = "garbage of the model"
    SLOW_LLM = "model slowed down"
    KILL_LLM = "model killed"
    FILL_DISK = "disk full"
    TAKE_DATABASE = "database gone"
    JUMP_CLOCK = "clock jumps"
    START_TWICE = "robot started twice"
    SPEAK_TWICE = "robot's id used twice"


SQLITE_ONLY = frozenset({Kind.FILL_DISK})


@dataclass(frozen=True)
class Strike:
    """One fault, with all that was drawn for it."""

    kind: Kind
    after_s: float
    """Quiet before it, seconds."""

    seconds: float
    """How long it lasts, where it lasts."""

    robot: int
    """Whom it strikes, where it strikes a robot; one outside of the world's process."""

    mode: Mode
    """How a language model misbehaves."""

    offset_s: float
    """By how much a clock jumps."""

    seed: int
    """Of what is random within it."""

    def __str__(self) -> str:
        match self.kind:
            case Kind.GARBLE_LLM:
                return f"{self.kind}: {self.mode.value}"
            case Kind.JUMP_CLOCK:
                return f"{self.kind} by {self.offset_s:+.0f} s"
            case kind if "vehicle" in kind or "robot" in kind or "MAVLink" in kind:
                return f"{self.kind}: {self.robot}"
        return self.kind.value


def schedule(seed: int, database: str, robots: tuple[int, ...]) -> Iterator[Strike]:
    """Yield faults for ever: every kind once in each round, in an order of the seed's own.

    Args:
        seed: One seed, one schedule.
        database: `sqlite` or `postgresql`; a served database has no small disk to fill.
        robots: Those with a process of their own, MAVLink vehicles first.
    """
    dice = random.Random(seed)
    kinds = [kind for kind in Kind if database == "sqlite" or kind not in SQLITE_ONLY]
    while True:
        for kind in dice.sample(kinds, len(kinds)):
            over_mavlink = kind in (Kind.LOSE_MAVLINK, Kind.GARBLE_MAVLINK)
            yield Strike(
                kind,
                round(dice.uniform(0.0, LONGEST_GAP_S), 2),
                round(dice.uniform(2.5, 4.5), 2),
                dice.choice(robots[:2] if over_mavlink else robots),
                dice.choice(GARBAGE),
                dice.choice((-86400.0, -3600.0, -90.0, 90.0, 3600.0, 86400.0)),
                dice.randrange(1 << 30),
            )
