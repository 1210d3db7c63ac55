"""The catalogue of a real server: scenarios that come with Falconer, models from the settings."""

from collections.abc import Mapping
from dataclasses import replace
from http import HTTPStatus
from typing import Any, Final

from pydantic import TypeAdapter

from llm.local import worker
from server.api.catalogue import Definition
from server.api.definitions import ENDPOINT, address_of, define_live
from server.api.errors import ServiceError
from server.api.models import Clock, LlmProfile, MissionRequest, ScenarioInfo
from server.bus import planner_bus
from server.lockstep.job import LockstepJob
from server.lockstep.job import dump_job as dump_lockstep_job
from server.mission.setup import MissionSetup
from server.models import LOCAL
from server.scenarios import library
from server.scenarios.errors import ScenarioError
from server.scenarios.schema import Scenario
from server.settings import Settings
from vehicles.world.setup import WorldSetup
from vehicles.zenoh_settings import ZenohSettings

_BUS: Final = TypeAdapter(ZenohSettings)


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
        if worker.missing() is None:
            words = "A small language model in a process of its own; no network."
            found.append(LlmProfile(name=LOCAL, description=words))
        if self._settings.llm_base_url is not None:
            name = self._settings.llm_model
            found.append(LlmProfile(name=ENDPOINT, description=f"The configured model, {name}."))
        return tuple(found)

    def describe(self, scenario: dict[str, Any]) -> ScenarioInfo:
        """Check a whole scenario and return what it is. Raises ServiceError 422."""
        return _info(_scenario(scenario))

    def bus(self, planner: Mapping[str, Any]) -> dict[str, Any]:
        """Return where a stored planner job stands on the bus by the settings, as JSON values."""
        setup = planner["setup"]
        robot_ids = tuple(robot["id"] for robot in setup["robots"])
        settings = planner_bus(self._settings, setup["team"], robot_ids)
        values: dict[str, Any] = _BUS.dump_python(settings, mode="json")
        return values

    def define(self, request: MissionRequest) -> Definition:
        """Check a request and return what to run. Raises ServiceError 422."""
        scenario = _scenario(request.scenario)
        if request.llm == LOCAL and (missing := worker.missing()):
            raise ServiceError("llm_unavailable", missing, HTTPStatus.UNPROCESSABLE_ENTITY)
        self.model_address(request.llm)
        scenario = scenario.varied(seed=request.seed)
        setup = scenario.mission_setup(self._settings.engine)
        if request.gate is not None:
            setup = replace(setup, gate=request.gate)
        if request.clock is Clock.LOCKSTEP:
            return self._in_lockstep(setup, scenario.world_setup(), request.llm)
        return define_live(
            setup,
            scenario.world_setup(),
            request.llm,
            self._settings,
        )

    def _in_lockstep(self, setup: MissionSetup, world: WorldSetup, llm: str) -> Definition:
        job = LockstepJob(setup, world, address_of(llm, self._settings))
        return Definition(
            scenario=setup.name,
            llm=llm,
            seed=setup.seed,
            clock=Clock.LOCKSTEP,
            gate=setup.gate,
            planner=dump_lockstep_job(job),
            world=None,
        )

    def model_address(self, profile: str) -> str:
        """Return what a profile stands for. Raises ServiceError 422."""
        if profile not in {known.name for known in self.profiles()}:
            raise ServiceError(
                "llm_unknown",
                f"There is no model profile {profile}; see GET /api/v1/llm-profiles.",
                HTTPStatus.UNPROCESSABLE_ENTITY,
            )
        return address_of(profile, self._settings)


def _scenario(asked: str | Mapping[str, Any]) -> Scenario:
    """Return a scenario by its name, or from plain data. Raises ServiceError 422."""
    try:
        return library.named(asked) if isinstance(asked, str) else library.inline(asked)
    except ScenarioError as error:
        raise ServiceError(
            "scenario_invalid", str(error), HTTPStatus.UNPROCESSABLE_ENTITY
        ) from error


def _info(scenario: Scenario) -> ScenarioInfo:
    return ScenarioInfo(
        name=scenario.name,
        description=scenario.description,
        robots=len(scenario.robots),
        targets=len(scenario.targets),
        zones=len(scenario.zones),
    )
