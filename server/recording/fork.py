"""What if: a recorded mission flown on from any instant, in lockstep, under other guidance.

The recorded inputs bring a fresh core to that instant, so the team knows what it knew. The world
goes on from the truth of that moment; where nobody knew the truth (real vehicles), from what the
team believed. A robot that is cut off at that instant starts from the team's knowledge: what it
had learned by itself is not on the tape.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from server.live.mission import ITERATIONS
from server.live.solving import Resolver
from server.lockstep.assembly import open_advice
from server.lockstep.council import Council
from server.lockstep.driver import Lockstep
from server.lockstep.job import Latency, ScriptedComment
from server.mission.core import MissionCore
from server.mission.setup import GateMode, MissionSetup
from server.mission.tape import NoTape, TapedCore, rewound
from server.recording.errors import RecordingError
from server.recording.reader import Recording
from server.settings import Settings
from solver import engines
from solver.observations import Comment
from solver.planner import Planner
from solver.snapshot import Snapshot, TrackStatus
from solver.streams import Streams
from vehicles import messages as wire
from vehicles.translation import zone_of
from vehicles.world.setup import (
    JammingLaw,
    NoiseLaw,
    WorldRobot,
    WorldSetup,
    WorldTarget,
    WorldZone,
)
from vehicles.world.state import Failures, TrueRobot, TrueTarget, Truth
from vehicles.world.world import World

RECOVER_DENSITY = 0.2
"""Where a believed world lets robots recover, 1/m^2: nobody on the team knows the true rule."""


@dataclass(frozen=True, slots=True)
class Change:
    """What is to be different."""

    at_s: float
    """Mission time of the fork."""

    llm: str
    latency: Latency
    comments: tuple[ScriptedComment, ...] = ()
    seed: int | None = None
    """Other dice from here on; None keeps the recorded ones."""

    gate: GateMode | None = None
    """Another gate from here on."""


async def fork(
    recording: Recording, change: Change, settings: Settings, progress: Callable[[int], None]
) -> dict[str, Any]:
    """Fly on from `change.at_s` to the end of the recording; return both stories' figures.

    Raises:
        RecordingError: The instant lies outside the recording.
        ModelUnavailable, EngineUnavailable: As for a lockstep run.
    """
    header = recording.header
    planner = Planner(engines.create(header.engine))
    core, said = _core_at(recording, change.at_s, planner)
    at_s = core.snapshot.time_s
    steps = round((recording.duration_s - at_s) / header.tick_s)
    if steps < 1:
        raise RecordingError(
            f"{recording.path}: it ends at {recording.duration_s:g} s; fork before that"
        )
    seed = header.setup.seed if change.seed is None else change.seed
    setup = replace(header.setup, tick_s=header.tick_s, steps=steps, seed=seed)
    world = _world_at(recording, core.snapshot, seed, at_s)
    taped = TapedCore(core, NoTape())
    gate = setup.gate if change.gate is None else change.gate
    council = Council(taped, gate, Planner(engines.create(header.engine)))
    async with open_advice(change.llm, settings, council, change.latency) as advice:
        run = Lockstep(setup, world, council, planner, advice, change.comments)
        run.take_over(said)
        result = await run.run(progress, at_s + header.tick_s)
    return {
        "at_s": at_s,
        "until_s": at_s + steps * header.tick_s,
        "recorded": _recorded(recording, at_s),
        "forked": {
            name: result[name]
            for name in ("accumulated_trace", "sensing_attacks", "communication_attacks")
        },
        "result": result,
    }


def _core_at(recording: Recording, at_s: float, planner: Planner) -> tuple[MissionCore, int]:
    """Return the core as it was, and how many comments it had heard."""
    said = 0

    def counted() -> Any:
        nonlocal said
        for entry in recording.entries():
            said += isinstance(getattr(entry, "observation", None), Comment)
            yield entry

    if not 0.0 <= at_s <= recording.duration_s:
        raise RecordingError(
            f"{recording.path}: there is no {at_s:g} s in it; it lasts from 0 to"
            f" {recording.duration_s:g} s"
        )
    try:
        resolver = Resolver(planner, ITERATIONS)
        core = rewound(recording.header.setup, counted(), resolver, at_s)
    except ValueError as error:
        raise RecordingError(f"{recording.path}: {error}") from None
    if core.snapshot.tick < 0:
        raise RecordingError(f"{recording.path}: it has no tick at or before {at_s:g} s")
    return core, said


def _world_at(recording: Recording, snapshot: Snapshot, seed: int, at_s: float) -> World:
    """Return the world of the instant: the true one, or the one the team believed in."""
    header = recording.header
    truth = recording.truth_at(at_s)
    if header.world is None or truth is None:
        return World(believed_world(header.setup, snapshot), Streams(seed))
    world = World(header.world, Streams(seed))
    world.take_over(_truth_of(truth))
    return world


def _truth_of(message: wire.Truth) -> Truth:
    return Truth(
        time_s=message.time_s,
        step=message.step,
        robots=tuple(
            TrueRobot(
                robot.id,
                robot.position,
                robot.velocity,
                robot.altitude_m,
                Failures(sensing=robot.sensing_failed, communication=robot.jammed),
            )
            for robot in message.robots
        ),
        targets=tuple(
            TrueTarget(target.id, target.position, target.velocity) for target in message.targets
        ),
        zones=tuple(zone_of(zone) for zone in message.zones),
    )


def believed_world(setup: MissionSetup, snapshot: Snapshot) -> WorldSetup:
    """Return a world in which everything the team believes at a snapshot is so."""
    tracks, robots = snapshot.tracks, snapshot.robots
    seen = (TrackStatus.TRACKED, TrackStatus.COASTING)
    return WorldSetup(
        robots=tuple(
            WorldRobot(
                id=robot.id,
                position=_point(robots.positions[row]),
                velocity=_point(robots.velocities[row]),
                altitude_m=robot.altitude_m,
                control_lower=robot.control_lower,
                control_upper=robot.control_upper,
                dynamics=setup.dynamics,
            )
            for row, robot in enumerate(setup.robots)
        ),
        targets=tuple(
            WorldTarget(target_id, _point(tracks.positions[row]), _point(tracks.velocities[row]))
            for row, target_id in enumerate(tracks.ids)
            if tracks.status[row] in seen
        ),
        zones=tuple(WorldZone(zone) for zone in snapshot.zones),
        attack_period_s=setup.planner.attack_period_s,
        recover_density=RECOVER_DENSITY,
        sensor=setup.sensor,
        noise=NoiseLaw.SOUND,
        jamming=JammingLaw.LINEAR,
    )


def _recorded(recording: Recording, at_s: float) -> dict[str, Any]:
    """Return what really came of it, over the same span; empty without recorded snapshots."""
    trace, first, last = 0.0, None, None
    for snapshot in recording.snapshots(at_s):
        if snapshot["time_s"] <= at_s + 1e-6:
            first = snapshot
            continue
        trace += snapshot["trace"] or 0.0
        last = snapshot
    if first is None or last is None:
        return {}
    return {
        "accumulated_trace": trace,
        **{
            f"{kind}_attacks": last["attacks"][kind] - first["attacks"][kind]
            for kind in ("sensing", "communication")
        },
    }


def _point(row: np.ndarray) -> tuple[float, float]:
    return float(row[0]), float(row[1])
