"""The catalogue of a real server: scenarios that come with Falconer, models from the settings."""

import json
from collections.abc import Sequence
from http import HTTPStatus

from server.api.catalogue import Definition
from server.api.errors import ServiceError
from server.api.models import Clock, LlmProfile, MissionRequest, ScenarioInfo
from server.bus import planner_bus
from server.live.job import PlannerJob
from server.live.job import dump_job as dump_planner_job
from server.mission.setup import MissionSetup
from server.scenarios import library
from server.scenarios.errors import ScenarioError
from server.scenarios.schema import Scenario
from server.settings import Settings
from vehicles.sim_worker import SimulationJob
from vehicles.sim_worker import dump_job as dump_world_job
from vehicles.simulation import SimulationSettings
from vehicles.world.setup import WorldSetup
from vehicles.zenoh_settings import ZenohSettings

ENDPOINT = "endpoint"
"""The profile of the model that the settings name."""


class ScenarioLibrary:
    """Makes definitions from requests. Names and profiles only: no paths, no addresses."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._known: tuple[ScenarioInfo, ...] = ()

    def scenarios(self) -> tuple[ScenarioInfo, ...]:
        """Return every scenario that comes with Falconer. They are read once."""
        if not self._known:
            self._known = tuple(_info(library.named(name)) for name in library.names())
        return self._known

    def profiles(self) -> tuple[LlmProfile, ...]:
        """Return the models that a mission may be given."""
        found = [
            LlmProfile(name="mock", description="Built-in rule model; no language model."),
            LlmProfile(name="exact", description="Our assignment solver; weights stay."),
            LlmProfile(name="none", description="Nobody advises: the scenario's directives stay."),
        ]
        if self._settings.llm_base_url is not None:
            name = self._settings.llm_model
            found.append(LlmProfile(name=ENDPOINT, description=f"The configured model, {name}."))
        return tuple(found)

    def define(self, request: MissionRequest) -> Definition:
        """Check a request and return what to run. Raises ServiceError 422."""
        try:
            if isinstance(request.scenario, str):
                scenario = library.named(request.scenario)
            else:
                scenario = library.inline(request.scenario)
        except ScenarioError as error:
            raise ServiceError(
                "scenario_invalid", str(error), HTTPStatus.UNPROCESSABLE_ENTITY
            ) from error
        if request.llm not in {profile.name for profile in self.profiles()}:
            raise ServiceError(
                "llm_unknown",
                f"There is no model profile {request.llm}; see GET /api/v1/llm-profiles.",
                HTTPStatus.UNPROCESSABLE_ENTITY,
            )
        scenario = scenario.varied(seed=request.seed)
        return define_live(
            scenario.mission_setup(self._settings.engine),
            scenario.world_setup(),
            request.llm,
            self._settings,
        )


def define_live(
    setup: MissionSetup,
    world: WorldSetup,
    llm: str,
    settings: Settings,
    comments: Sequence[tuple[float, str]] = (),
) -> Definition:
    """Return the definition of a live mission.

    Its world is simulated beside it unless the settings name a bus: then the vehicles,
    simulated or real, are whoever is there. `llm` is a profile, or (from the command line)
    an address.
    """
    elsewhere = settings.zenoh_connect is not None or settings.zenoh_listen is not None
    address = settings.llm_base_url if llm == ENDPOINT and settings.llm_base_url else llm
    job = PlannerJob(setup, address, planner_bus(settings), tuple(comments))
    return Definition(
        scenario=setup.name,
        llm=llm,
        seed=setup.seed,
        clock=Clock.REALTIME,
        planner=dump_planner_job(job),
        world=None if elsewhere else _world(setup, world),
    )


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


def _info(scenario: Scenario) -> ScenarioInfo:
    return ScenarioInfo(
        name=scenario.name,
        description=scenario.description,
        robots=len(scenario.robots),
        targets=len(scenario.targets),
        zones=len(scenario.zones),
    )
