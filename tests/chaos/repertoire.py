"""Which function does which fault."""

from collections.abc import Awaitable, Callable

from tests.chaos import faults, noise
from tests.chaos.schedule import Kind, Strike
from tests.chaos.team import Team

Fault = Callable[[Team, Strike], Awaitable[str]]

FAULTS: dict[Kind, Fault] = {
    Kind.KILL_VEHICLE: faults.kill_vehicle,
    Kind.STOP_VEHICLE: faults.stop_vehicle,
    Kind.KILL_PLANNER: faults.kill_planner,
    Kind.STOP_PLANNER: faults.stop_planner,
    Kind.SLOW_PLANNER: faults.slow_planner,
    Kind.KILL_SERVER: faults.kill_server,
    Kind.KILL_ROUTER: faults.kill_router,
    Kind.STOP_ROUTER: faults.stop_router,
    Kind.CUT_NETWORK: faults.cut_network,
    Kind.LOSE_MAVLINK: faults.lose_mavlink,
    Kind.GARBLE_MAVLINK: noise.garble_mavlink,
    Kind.GARBLE_BUS: noise.garble_bus,
    Kind.FLOOD_BUS: noise.flood_bus,
    Kind.FLOOD_API: faults.flood_api,
    Kind.GARBLE_LLM: faults.garble_llm,
    Kind.SLOW_LLM: faults.slow_llm,
    Kind.KILL_LLM: faults.kill_llm,
    Kind.FILL_DISK: faults.fill_disk,
    Kind.TAKE_DATABASE: faults.take_database,
    Kind.JUMP_CLOCK: faults.jump_clock,
    Kind.START_TWICE: faults.start_twice,
    Kind.SPEAK_TWICE: noise.speak_twice,
}
