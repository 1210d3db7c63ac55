"""`falconer vehicle`: what runs beside a vehicle, and what stands in for one."""

import asyncio
from collections.abc import Callable, Coroutine
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import typer

from server.cli import vehicle_options as options
from server.cli.bus import bus_of
from server.cli.endless import log_to_stderr, until_interrupted
from server.cli.errors import UsageError
from server.cli.options import EngineName, ScenarioArgument
from server.settings import load_settings
from vehicles.mavlink.alignment import Heights
from vehicles.mavlink.dialects import DIALECTS, Autopilot
from vehicles.mavlink.flight import FlightSettings, Start
from vehicles.mavlink.limits import FlightLimits
from vehicles.messages import Order
from vehicles.senses import Sight

if TYPE_CHECKING:
    from server.scenarios.schema import Scenario
    from vehicles.launch import Place

    Run = Callable[[Callable[[], None]], Coroutine[Any, Any, None]]

TAKEOFF_ALTITUDE_M = 2.0
TEAM = "falcons"

vehicle = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    help="Put MAVLink vehicles, real or simulated, into a team; give a robot an order.",
)


@vehicle.command()
def mavlink(
    robot: options.RobotOption,
    connect: options.LinkOption,
    autopilot: options.AutopilotOption = Autopilot.ARDUPILOT,
    system: options.SystemOption = 1,
    zenoh_connect: options.BusOption = None,
    scenario: options.TeamScenarioOption = None,
    team: options.TeamOption = None,
    datum: options.DatumOption = None,
    heights: options.HeightsOption = Heights.OWN_ORIGIN,
    local_frame: options.LocalFrameOption = None,
    tags: options.TagsOption = None,
    allow_takeoff: options.AllowTakeoffOption = False,
    takeoff_altitude: options.TakeoffAltitudeOption = None,
    speed_limit: options.SpeedLimitOption = 5.0,
    low_battery: options.LowBatteryOption = 0.2,
    senses: options.SensesOption = Sight.NONE,
    autonomous: options.AutonomousOption = 0.0,
    signing_key: options.KeyOption = None,
    engine: options.EngineOption = None,
) -> None:
    """Fly a MAVLink vehicle (ArduPilot in GUIDED, PX4 in OFFBOARD) for its team."""
    from vehicles.mavlink.guard import TakeOffRule
    from vehicles.mavlink.launch import VehicleOptions, run_vehicle

    chosen = _scenario_with(robot, scenario)
    if sum(given is not None for given in (datum, local_frame, tags)) > 1:
        raise UsageError(
            "--datum, --local-frame and --tags each say where the vehicle is: give one"
        )
    known = None if tags is None else options.tags_of(tags)
    if known is not None and known.targets and senses is not Sight.NONE:
        raise UsageError("--tags names targets that the vehicle sees: --senses must be none then")
    flown = VehicleOptions(
        robot_id=robot,
        endpoint=options.endpoint_of(connect),
        autopilot=autopilot,
        system=system,
        take_off=TakeOffRule.ALLOWED if allow_takeoff else TakeOffRule.FORBIDDEN,
        take_off_altitude_m=_altitude_m(takeoff_altitude, chosen, robot),
        limits=_limits(chosen, FlightLimits(speed_m_s=speed_limit, battery_least=low_battery)),
        datum=None if datum is None else options.datum_of("--datum", datum),
        heights=heights,
        alignment=options.alignment_of(local_frame),
        tags=None if known is None else known.tags,
        targets={} if known is None else known.targets,
        key_file=signing_key,
    )
    place = _place(_team(team, chosen), zenoh_connect, engine, senses, autonomous)
    _fly(robot, place, f"its vehicle is at {flown.endpoint}", partial(run_vehicle, flown, place))


@vehicle.command("sim")
def sim_robot(
    scenario: ScenarioArgument,
    robot: options.RobotOption,
    zenoh_connect: options.BusOption = None,
    senses: options.SensesOption = Sight.WORLD,
    autonomous: options.AutonomousOption = 0.0,
    engine: options.EngineOption = None,
) -> None:
    """Simulate one robot of SCENARIO by itself; the world of falconer sim may sense for it."""
    from vehicles.lone import run_lone

    chosen = _with_robot(robot, scenario)
    team = chosen.team
    own = next(one for one in chosen.world_setup().robots if one.id == robot)
    place = _place(team, zenoh_connect, engine, senses, autonomous)
    _fly(robot, place, "simulated here", partial(run_lone, own, place))


def _place(
    team: str, bus: str | None, engine: EngineName | None, sight: Sight, autonomous_s: float
) -> "Place":
    """Return a robot's place in its team. Raises UsageError."""
    from vehicles.launch import Place
    from vehicles.settings import AgentSettings

    # Started before the mission it waits: a vehicle without a planner holds anyway.
    zenoh = replace(bus_of(bus), open_timeout_s=None)
    chosen = load_settings().engine if engine is None else engine.value
    try:
        return Place(team, zenoh, chosen, sight, AgentSettings(autonomous_s=autonomous_s))
    except ValueError as error:
        raise UsageError(str(error)) from error


def _fly(robot_id: int, place: "Place", where: str, run: "Run") -> None:
    """Fly until interrupted. Raises UsageError for what cannot work."""
    from vehicles.agent import DuplicateRobotError
    from vehicles.bus import BusError

    who = f"robot {robot_id} of team {place.team}"
    log_to_stderr()
    typer.echo(f"{who}: waiting for the bus at {', '.join(place.zenoh.connect)}", err=True)

    def ready() -> None:
        typer.echo(f"{who}: announced; {where} (Ctrl-C ends it)", err=True)

    try:
        asyncio.run(until_interrupted(run(ready)))
    except (BusError, DuplicateRobotError, ValueError) as error:
        raise UsageError(str(error)) from error


@vehicle.command("sim-autopilot")
def sim_autopilot(
    connect: options.LinkOption = "udpout:127.0.0.1:14550",
    autopilot: options.AutopilotOption = Autopilot.ARDUPILOT,
    system: options.SystemOption = 1,
    origin: options.OriginOption = "47.0,8.0,400",
    home: options.HomeOption = "0,0",
    start: options.StartOption = Start.GROUND,
    altitude: options.AltitudeOption = 2.0,
    battery: options.BatteryOption = 1.0,
    battery_life: options.BatteryLifeOption = 1200.0,
    setpoint_loss: options.SetpointLossOption = None,
    refuse: options.RefuseOption = None,
    signing_key: options.KeyOption = None,
) -> None:
    """Simulate an autopilot that speaks MAVLink over UDP: to try things without hardware."""
    from vehicles.mavlink.autopilot import AutopilotSettings
    from vehicles.mavlink.signing import SigningError
    from vehicles.mavlink.simulator import run_autopilot
    from vehicles.mavlink.udp import EndpointError

    east, north = options.numbers_of("--home", home, (2,))
    dialect = DIALECTS[autopilot]
    flight = FlightSettings(
        dialect=dialect,
        home=(east, north, 0.0),
        start=start,
        start_altitude_m=altitude,
        setpoint_loss_s=setpoint_loss,
        battery_start=battery,
        battery_s=battery_life,
        refused_modes=options.modes_of(refuse, dialect.names),
    )
    settings = AutopilotSettings(flight, system, options.datum_of("--origin", origin))
    endpoint = options.endpoint_of(connect)
    log_to_stderr()

    def ready() -> None:
        typer.echo(f"{autopilot.value} {system} at {endpoint} (Ctrl-C ends it)", err=True)

    try:
        asyncio.run(until_interrupted(run_autopilot(settings, endpoint, signing_key, ready)))
    except (EndpointError, SigningError) as error:
        raise UsageError(str(error)) from error


@vehicle.command("order")
def give_order(
    order: Annotated[
        Order, typer.Argument(metavar="ORDER", help="hold, land, return, take_off or resume.")
    ],
    robot: options.RobotOption,
    zenoh_connect: options.BusOption = None,
    scenario: options.TeamScenarioOption = None,
    team: options.TeamOption = None,
    patience: options.PatienceOption = 60.0,
) -> None:
    """Give one robot an operator's order and wait until it is done or refused."""
    from vehicles.bus import BusError
    from vehicles.orders import OrderRefused, OrderUnanswered, give

    chosen = _scenario_with(robot, scenario)
    bus = bus_of(zenoh_connect)
    try:
        answer = asyncio.run(give(bus, _team(team, chosen), robot, order, patience))
    except (BusError, ValueError) as error:
        raise UsageError(str(error)) from error
    except (OrderRefused, OrderUnanswered) as error:
        typer.echo(f"falconer: {error}", err=True)
        raise typer.Exit(1) from error
    typer.echo(f"robot {robot}: {answer}")


# ---------------------------------------------------------------------- of the scenario


def _scenario_with(robot_id: int, name: str | None) -> "Scenario | None":
    """Return the mission's scenario, if it is named. Raises UsageError."""
    return None if name is None else _with_robot(robot_id, name)


def _with_robot(robot_id: int, name: str) -> "Scenario":
    """Return a scenario. Raises UsageError when the robot is not in it."""
    from server.scenarios import library

    chosen = library.load(name)
    known = [robot.id for robot in chosen.robots]
    if robot_id not in known:
        listed = ", ".join(map(str, known))
        raise UsageError(f"--robot {robot_id}: the robots of {chosen.name} are {listed}")
    return chosen


def _team(name: str | None, scenario: "Scenario | None") -> str:
    if name is not None:
        return name
    return TEAM if scenario is None else scenario.team


def _altitude_m(given_m: float | None, scenario: "Scenario | None", robot_id: int) -> float:
    if given_m is not None or scenario is None:
        return TAKEOFF_ALTITUDE_M if given_m is None else given_m
    return next(robot.altitude_m for robot in scenario.robots if robot.id == robot_id)


def _limits(scenario: "Scenario | None", limits: FlightLimits) -> FlightLimits:
    """Return limits with the scenario's field."""
    if scenario is None:
        return limits
    field = scenario.field
    return replace(limits, field_lower=field.lower, field_upper=field.upper)
