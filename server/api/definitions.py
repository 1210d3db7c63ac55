"""Definitions of missions from setups and settings: what a planner's process and a world's get."""

import json
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from server.api.catalogue import Definition
from server.api.models import Clock
from server.bus import planner_bus
from server.live.job import PlannerJob, dump_job
from server.mission.setup import MissionSetup
from server.settings import Settings
from vehicles.settings import SimulationSettings
from vehicles.sim_job import SimulationJob
from vehicles.sim_job import dump_job as dump_world_job
from vehicles.world.setup import WorldSetup
from vehicles.zenoh_settings import ZenohSettings

ENDPOINT: Final = "endpoint"
"""The profile of the model that the settings name."""


def address_of(llm: str, settings: Settings) -> str:
    """Return what a profile stands for; any other choice of a model stands for itself."""
    return settings.llm_base_url if llm == ENDPOINT and settings.llm_base_url else llm


def define_live(
    setup: MissionSetup,
    world: WorldSetup,
    llm: str,
    settings: Settings,
    comments: Sequence[tuple[float, str]] = (),
    record: Path | None = None,
) -> Definition:
    """Return the definition of a live mission.

    Its world is simulated beside it unless the settings name a bus: then the vehicles,
    simulated or real, are whoever is there. `llm` is a profile, or (from the command line)
    an address. It is recorded into the file `record`, else into the settings' folder, if any.
    """
    elsewhere = settings.zenoh_connect is not None or settings.zenoh_listen is not None
    if record is None and settings.recordings is not None:
        record = settings.recordings / recording_name(setup.name, datetime.now(UTC))
    job = PlannerJob(
        setup,
        address_of(llm, settings),
        planner_bus(settings, setup.team, setup.robot_ids),
        tuple(comments),
        record=None if record is None else record.resolve(),
        world=None if elsewhere else world,
    )
    return Definition(
        scenario=setup.name,
        llm=llm,
        seed=setup.seed,
        clock=Clock.REALTIME,
        gate=setup.gate,
        planner=dump_job(job),
        world=None if elsewhere else _world(setup, world),
    )


def recording_name(scenario: str, now: datetime) -> str:
    """Return the file name of a recording that begins now."""
    safe = re.sub(r"[^A-Za-z0-9_-]+", "-", scenario).strip("-") or "mission"
    return f"{safe[:40]}-{now:%Y%m%dT%H%M%S%f}Z.mcap"


def _world(setup: MissionSetup, world: WorldSetup) -> dict[str, object]:
    """Return the job of a simulated world; its endpoint is filled in when it is started."""
    job = SimulationJob(
        world=world,
        team=setup.team,
        zenoh=ZenohSettings(connect=("tcp/127.0.0.1:0",)),
        simulation=SimulationSettings(seed=setup.seed, tick_s=setup.live_tick_s),
        engine=setup.planner.engine,
    )
    values: dict[str, object] = json.loads(dump_world_job(job))
    return values
