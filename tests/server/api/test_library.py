import copy
import json
from dataclasses import asdict
from typing import Any

import pytest

from llm.local import worker
from server.api.definitions import ENDPOINT, define_live
from server.api.errors import ServiceError
from server.api.library import ScenarioLibrary
from server.api.models import MissionRequest
from server.live.channel import encode
from server.live.job import JobError, load_job
from server.scenarios import library
from server.settings import Settings
from vehicles.sim_job import load_job as load_world_job
from vehicles.zenoh_settings import ZenohMode

LIBRARY = ScenarioLibrary(Settings())
HARDWARE: dict[str, Any] = library.named("hardware").model_dump(mode="json", exclude_unset=True)


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return the hardware scenario with one value changed."""
    scenario = copy.deepcopy(HARDWARE)
    *way, last = path.split(".")
    place: Any = scenario
    for part in way:
        place = place[int(part) if part.isdigit() else part]
    place[int(last) if last.isdigit() else last] = value
    return scenario


def refused(**request: Any) -> ServiceError:
    with pytest.raises(ServiceError) as error:
        LIBRARY.define(MissionRequest.model_validate(request))
    return error.value


def test_every_scenario_that_comes_along_is_listed() -> None:
    listed = {info.name: info for info in LIBRARY.scenarios()}
    assert set(listed) == set(library.names())
    assert (listed["demo"].robots, listed["demo"].targets) == (4, 6)
    assert all(info.description for info in listed.values())


@pytest.mark.parametrize("name", library.names())
def test_jobs_survive_the_channel(name: str) -> None:
    scenario = library.named(name)
    setup, world = scenario.mission_setup(), scenario.world_setup()
    comments = ((1.5, "Focus."),)
    definition = define_live(setup, world, "mock", Settings(), comments)
    job = load_job(json.loads(encode(definition.planner)))
    assert asdict(job.setup) == asdict(setup)
    assert job.comments == comments
    assert job.bus.listen == ("tcp/127.0.0.1:0",)
    assert definition.world is not None
    simulated = load_world_job(encode(definition.world))
    assert asdict(simulated.world) == asdict(world)
    assert simulated.simulation.seed == setup.seed
    assert simulated.team == setup.team


def test_a_request_makes_a_definition_with_its_seed() -> None:
    definition = LIBRARY.define(MissionRequest(scenario="hardware", llm="none", seed=42))
    assert (definition.scenario, definition.llm, definition.seed) == ("hardware", "none", 42)
    assert load_job(definition.planner).setup.seed == 42


def test_a_scenario_may_be_brought_along() -> None:
    definition = LIBRARY.define(MissionRequest(scenario=HARDWARE))
    assert load_job(definition.planner).setup.robot_ids == (21, 26)


@pytest.mark.parametrize(
    ("scenario", "word"),
    [
        ("nowhere", "nowhere"),
        (changed("surprise", 1), "surprise"),
        (changed("robots.0.capacity", 0), "capacity"),
        (changed("robots.0.position", [float("nan"), 0.0]), "position"),
        (changed("robots.1.id", 21), "21"),
        (changed("zones.0.covariance", [[-1.0, 0.0], [0.0, 1.0]]), "covariance"),
        ({}, "robots"),
    ],
)
def test_a_bad_scenario_names_what_is_wrong(scenario: Any, word: str) -> None:
    error = refused(scenario=scenario)
    assert (error.status, error.code) == (422, "scenario_invalid")
    assert word in error.message


def test_models_are_profiles_not_addresses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "missing", lambda: None)
    assert [p.name for p in LIBRARY.profiles()] == ["mock", "exact", "none", "local"]
    assert refused(scenario="hardware", llm="endpoint").code == "llm_unknown"
    configured = Settings(llm_base_url="http://127.0.0.1:8080/v1", llm_model="small")
    found = ScenarioLibrary(configured)
    assert [p.name for p in found.profiles()] == ["mock", "exact", "none", "local", ENDPOINT]
    definition = found.define(MissionRequest(scenario="hardware", llm="local"))
    assert load_job(definition.planner).llm == "local"
    definition = found.define(MissionRequest(scenario="hardware", llm=ENDPOINT))
    assert load_job(definition.planner).llm == "http://127.0.0.1:8080/v1"


def test_the_embedded_model_is_offered_where_it_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(worker, "missing", lambda: worker.MISSING)
    assert [p.name for p in LIBRARY.profiles()] == ["mock", "exact", "none"]
    error = refused(scenario="hardware", llm="local")
    assert (error.status, error.code) == (422, "llm_unavailable")
    assert "make setup-local" in error.message


def test_with_a_bus_named_the_vehicles_are_elsewhere() -> None:
    scenario = library.named("hardware")
    listening = Settings(zenoh_listen="tcp/127.0.0.1:7447")
    joining = Settings(zenoh_connect="tcp/127.0.0.1:7447")
    for settings, mode in ((listening, ZenohMode.ROUTER), (joining, ZenohMode.CLIENT)):
        definition = define_live(scenario.mission_setup(), scenario.world_setup(), "none", settings)
        assert definition.world is None
        bus = load_job(definition.planner).bus
        assert bus.mode is mode
        assert (*bus.listen, *bus.connect) == ("tcp/127.0.0.1:7447",)


def test_a_job_that_makes_no_sense_names_its_fields() -> None:
    with pytest.raises(JobError, match="setup"):
        load_job({"llm": "none"})
