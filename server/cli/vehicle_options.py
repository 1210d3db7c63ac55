"""Options of `falconer vehicle`, and what their texts mean."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, ValidationError, model_validator

from server.cli.bus import DEFAULT_BUS
from server.cli.errors import UsageError
from server.cli.options import EngineName, finite
from vehicles.mavlink.alignment import Heights
from vehicles.mavlink.dialects import Autopilot
from vehicles.mavlink.flight import Start
from vehicles.mavlink.frames import Alignment, Datum
from vehicles.mavlink.udp import Endpoint, EndpointError, parse_endpoint
from vehicles.senses import Sight

RobotOption = Annotated[int, typer.Option(min=0, help="The robot's id in its team.")]
TeamOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Its team; default: the scenario's, or falcons.")
]
TeamScenarioOption = Annotated[
    str | None,
    typer.Option(
        metavar="SCENARIO",
        help="The mission's: gives the team, the field and the altitude; the robot must be in it.",
    ),
]
BusOption = Annotated[
    str | None,
    typer.Option(
        metavar="ENDPOINT",
        help=f"Where the mission or a router listens; default {DEFAULT_BUS}. "
        "Several with commas between them: whichever answers.",
    ),
]
LinkOption = Annotated[
    str,
    typer.Option(
        metavar="LINK",
        help="udpin:HOST:PORT waits for the other end, udpout:HOST:PORT speaks to it.",
    ),
]
KeyOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="Sign, and demand signatures (MAVLink 2): 32 bytes or 64 hex digits."
    ),
]
AutopilotOption = Annotated[Autopilot, typer.Option(help="Which autopilot it is.")]
SystemOption = Annotated[int, typer.Option(min=1, max=255, help="Its MAVLink system id.")]
DatumOption = Annotated[
    str | None,
    typer.Option(
        metavar="LAT,LON[,ALT]",
        help="Origin of the team's common frame, degrees and metres above the sea.",
    ),
]
HeightsOption = Annotated[
    Heights, typer.Option(help="What altitudes count from, where there is a datum.")
]
LocalFrameOption = Annotated[
    str | None,
    typer.Option(
        metavar="X,Y,Z,YAW",
        help="Where the vehicle's own frame lies in the common one, in metres and degrees "
        "anticlockwise: instead of a datum.",
    ),
]
TagsOption = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE",
        help="YAML: places of tags in the common frame, which the vehicle's camera sees: instead "
        "of a datum. And which targets carry tags: it sees those for the team.",
    ),
]
AllowTakeoffOption = Annotated[
    bool, typer.Option("--allow-takeoff", help="Arm and take off when an operator orders it.")
]
TakeoffAltitudeOption = Annotated[
    float | None,
    typer.Option(
        callback=finite, min=0.5, max=120.0, help="Metres; default: the scenario's, or 2."
    ),
]
SpeedLimitOption = Annotated[
    float,
    typer.Option(callback=finite, min=0.1, max=50.0, help="Faster setpoints are refused, m/s."),
]
LowBatteryOption = Annotated[
    float, typer.Option(callback=finite, min=0.0, max=0.99, help="Charge that is reported as low.")
]
SensesOption = Annotated[
    Sight, typer.Option(help="Who sees targets for it: nobody, or the world of falconer sim.")
]
EngineOption = Annotated[
    EngineName | None, typer.Option(help="Optimizer for flying alone when it is cut off.")
]
AutonomousOption = Annotated[
    float,
    typer.Option(
        callback=finite,
        min=0.0,
        max=600.0,
        help="Seconds it flies alone when the planner falls silent; 0: holds.",
    ),
]
OriginOption = Annotated[
    str, typer.Option(metavar="LAT,LON[,ALT]", help="Where its local frame lies on Earth.")
]
HomeOption = Annotated[
    str, typer.Option(metavar="X,Y", help="Where it stands, metres east and north of its origin.")
]
StartOption = Annotated[
    Start, typer.Option(help="On the ground, or in the air and following setpoints.")
]
AltitudeOption = Annotated[
    float,
    typer.Option(callback=finite, min=0.5, max=120.0, help="Metres, where it starts in the air."),
]
BatteryOption = Annotated[
    float,
    typer.Option(
        callback=finite, min=0.0, max=1.0, help="Charge at the start; at 0.15 it saves itself."
    ),
]
BatteryLifeOption = Annotated[
    float,
    typer.Option(
        callback=finite, min=1.0, max=1e5, help="Seconds that a full battery lasts in the air."
    ),
]
SetpointLossOption = Annotated[
    float | None,
    typer.Option(
        callback=finite,
        min=0.1,
        max=60.0,
        help="Seconds without a setpoint until it stops; default 3, and 1 for px4.",
    ),
]
RefuseOption = Annotated[
    list[str] | None,
    typer.Option(metavar="MODE", help="A mode it refuses, such as GUIDED. Several times."),
]
PatienceOption = Annotated[
    float,
    typer.Option(
        callback=finite, min=0.1, max=600.0, help="Seconds to wait for the robot's answer."
    ),
]


def endpoint_of(text: str) -> Endpoint:
    """Return the link a text names. Raises UsageError."""
    try:
        return parse_endpoint(text)
    except EndpointError as error:
        raise UsageError(f"--connect {error}") from error


def datum_of(option: str, text: str) -> Datum:
    """Return the place on Earth a text names. Raises UsageError."""
    try:
        return Datum(*numbers_of(option, text, (2, 3)))
    except ValueError as error:
        raise UsageError(f"{option} {text!r}: {error}") from error


def alignment_of(text: str | None) -> Alignment:
    """Return how a local frame lies in the common one, the same without a text.

    Raises UsageError.
    """
    if text is None:
        return Alignment()
    x, y, z, yaw_deg = numbers_of("--local-frame", text, (4,))
    return Alignment(shift=(x, y, z), yaw_rad=math.radians(yaw_deg))


class TagFile(BaseModel):
    """Where tags hang, and which targets carry others."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    tags: dict[
        Annotated[int, Field(ge=0, le=255)], tuple[FiniteFloat, FiniteFloat, FiniteFloat]
    ] = Field(min_length=2)
    targets: dict[Annotated[int, Field(ge=0, le=255)], Annotated[int, Field(ge=0)]] = Field(
        default_factory=dict
    )
    """Target by the number of its tag."""

    @model_validator(mode="after")
    def _apart(self) -> "TagFile":
        if both := self.tags.keys() & self.targets.keys():
            raise ValueError(f"tag {min(both)} hangs somewhere and is on a target")
        return self


def tags_of(path: Path) -> TagFile:
    """Return what a file tells of tags. Raises UsageError."""
    from server.scenarios.errors import ScenarioError
    from server.scenarios.reading import read

    try:
        return TagFile.model_validate(read(path))
    except ScenarioError as error:
        raise UsageError(f"--tags {error}") from error
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        where = ".".join(str(part) for part in problem["loc"]) or "file"
        raise UsageError(f"--tags {path}: {where}: {problem['msg']}") from error


def numbers_of(option: str, text: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    """Return the finite numbers between commas. Raises UsageError."""
    try:
        numbers = tuple(map(float, text.split(",")))
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(map(math.isfinite, numbers)):
        wanted = " or ".join(map(str, counts))
        raise UsageError(f"{option} {text!r}: expected {wanted} numbers with commas between them")
    return numbers


def modes_of(texts: list[str] | None, names: Mapping[int, str]) -> frozenset[int]:
    """Return the numbers of modes given by name. Raises UsageError."""
    numbers = {name: number for number, name in names.items()}
    for text in texts or ():
        if text.upper() not in numbers:
            raise UsageError(f"--refuse {text!r}: its modes are {', '.join(sorted(numbers))}")
    return frozenset(numbers[text.upper()] for text in texts or ())
