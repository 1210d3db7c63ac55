"""Alarms: what events make of them, and what is done with them over HTTP."""

import re
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import httpx
import pytest
import pytest_asyncio

from server.api.alarm_models import ALARM_ID, Alarm
from server.api.alarms import MAX_ALARMS, QUIET_S, SETTLE_S, AlarmBook, cause_of
from server.api.models import MissionRequest
from server.api.record import MissionRecord
from server.api.revival import Remains, Revived
from server.encoding import EventKind, MissionState, Severity, event_message
from server.journal.database import DatabaseJournal
from server.journal.entry import EntryKind
from server.journal.store import Store
from server.live.channel import frame
from server.mission.core import MissionCore
from server.scenarios import library
from tests.console.messages import message
from tests.server.api.serving import Stage, StagedService, client_of
from tests.server.scripted import ScriptedCatalogue
from tests.server.waiting import eventually

MISSION = "/api/v1/missions/m1"
REQUEST = MissionRequest(scenario="scripted")
KIND, BAD, GOOD = EventKind, Severity.WARNING, Severity.INFO


def event(
    what: EventKind, severity: Severity, time_s: float = 1.0, /, **data: Any
) -> dict[str, Any]:
    return event_message("m1", 1, time_s, what, severity, "It happened.", data)


def jammed(time_s: float, severity: Severity = BAD, link: str = "jammed") -> dict[str, Any]:
    return event(KIND.LINK, severity, time_s, robot=31, link=link)


def book(*events: dict[str, Any]) -> AlarmBook:
    made = AlarmBook()
    for each in events:
        made.take(each)
    return made


def only(made: AlarmBook) -> Alarm:
    (alarm,) = made.all()
    return alarm


@pytest.mark.parametrize(
    ("happened", "alarm_id", "over"),
    [
        (event(KIND.ATTACK, BAD, robot=21, kind="sensing", zone="s1"), "sensing-21", False),
        (event(KIND.RECOVERY, GOOD, robot=21), "sensing-21", True),
        (event(KIND.LINK, BAD, robot=31, link="jammed"), "link-31", False),
        (event(KIND.LINK, Severity.ALARM, robot=31, link="lost"), "link-31", False),
        (event(KIND.LINK, GOOD, robot=31, link="connected"), "link-31", True),
        (event(KIND.LINK, BAD, code="duplicate", robot=31), "bus-duplicate-31", False),
        (event(KIND.LINK, BAD, code="dropped"), "bus-dropped", False),
        (event(KIND.ALARM, Severity.ALARM, target=122), "target-122", False),
        (event(KIND.RECOVERY, GOOD, target=122), "target-122", True),
        (event(KIND.ALARM, BAD, rung="brake"), "optimizer", False),
        (event(KIND.LOOP, BAD, loop="task", tries=3), "model-task", False),
        (event(KIND.LOOP, GOOD, loop="task", tries=1), "model-task", True),
        (event(KIND.LOOP, BAD, guidance="last_valid"), "guidance", False),
        (event(KIND.LOOP, GOOD, guidance="model"), "guidance", True),
        (event(KIND.ALARM, Severity.ALARM, component="journal"), "journal", False),
        (event(KIND.ALARM, GOOD, component="journal"), "journal", True),
        (event(KIND.ALARM, Severity.WARNING, component="clock"), "clock", False),
        (event(KIND.HOLD, BAD, component="server"), "interruption", False),
        (event(KIND.ENDED, Severity.ALARM), "mission", False),
    ],
)
def test_events_name_their_alarm(happened: dict[str, Any], alarm_id: str, over: bool) -> None:
    cause = cause_of(happened)
    assert cause is not None
    assert (cause.id, cause.over) == (alarm_id, over)


@pytest.mark.parametrize(
    "happened",
    [
        event(KIND.ATTACK, BAD, robot=21, kind="communication"),  # its link tells
        event(KIND.LINK, GOOD, code="mode"),
        event(KIND.HOLD, BAD),  # a person did it
        event(KIND.DECISION, BAD, decision={"id": "d1"}),
        event(KIND.COMMENT, GOOD, comment="c1"),
        event(KIND.ENDED, GOOD),
    ],
)
def test_other_events_are_no_alarms(happened: dict[str, Any]) -> None:
    assert cause_of(happened) is None


def test_what_happens_again_counts_up_one_alarm() -> None:
    made = book(jammed(10.0), jammed(12.0, GOOD, "connected"), jammed(65.0), jammed(70.0))
    alarm = only(made)
    assert (alarm.count, alarm.since_s, alarm.last_s, alarm.active) == (3, 65.0, 70.0, True)
    assert alarm.rate_per_min == 2.0  # the first one is older than a minute
    assert alarm.title == "Robot 31 is cut off"


def test_acknowledging_is_undone_when_it_is_raised_anew_or_becomes_worse() -> None:
    noted = event(KIND.ALARM, GOOD, 11.0, acknowledged="link-31", by="ada")
    again = event(KIND.ALARM, GOOD, 11.5, acknowledged="link-31", by="bob")
    made = book(jammed(10.0), noted, again, jammed(12.0))
    found = only(made).acknowledged
    assert found is not None
    assert (found.by, found.time_s) == ("ada", 11.0)
    made.take(jammed(13.0, Severity.ALARM, "lost"))
    assert only(made).acknowledged is None
    assert only(made).severity == "alarm"
    made.take(event(KIND.ALARM, GOOD, 14.0, acknowledged="link-31", by="ada"))
    made.take(jammed(15.0, GOOD, "connected"))
    assert only(made).acknowledged is not None
    assert only(made).over_s == 15.0
    made.take(jammed(16.0))
    assert only(made).acknowledged is None
    assert only(made).severity == "warning"


def test_pictures_end_what_they_show_to_be_well_and_only_that() -> None:
    """In the picture robot 31 is jammed, 26 blind, 21 well, and target 122 is tracked."""
    made = book(
        jammed(10.0),
        event(KIND.ATTACK, BAD, 10.0, robot=26, kind="sensing"),
        event(KIND.ATTACK, BAD, 10.0, robot=21, kind="sensing"),
        event(KIND.ALARM, Severity.ALARM, 10.0, target=122),
        event(KIND.LOOP, BAD, 10.0, loop="task"),
        event(KIND.ALARM, Severity.ALARM, 10.0, component="planner"),
        event(KIND.ALARM, Severity.ALARM, 10.0, component="world"),
    )
    made.look(message(10.0 + 0.5 * SETTLE_S))
    assert all(alarm.active for alarm in made.all())
    made.look(message(10.5 + SETTLE_S))
    standing = {alarm.id for alarm in made.all() if alarm.active}
    assert standing == {"link-31", "sensing-26", "model-task", "world"}


def test_what_has_no_end_of_its_own_is_over_once_it_is_quiet() -> None:
    made = book(event(KIND.ALARM, BAD, 10.0, rung="brake"))
    made.look(message(10.0 + QUIET_S))
    assert only(made).active
    made.look(message(10.1 + QUIET_S))
    assert not only(made).active


def test_back_in_time_is_another_flight() -> None:
    made = book(jammed(100.0))
    made.look(message(0.5))
    assert not only(made).active
    made.take(jammed(1.0))
    assert (only(made).since_s, only(made).count, only(made).rate_per_min) == (1.0, 2, 1.0)


def test_the_number_of_alarms_is_bounded_and_those_that_are_over_go_first() -> None:
    made = book(*(event(KIND.ALARM, BAD, 1.0, target=n) for n in range(MAX_ALARMS)))
    made.take(event(KIND.RECOVERY, GOOD, 2.0, target=7))
    made.take(event(KIND.ALARM, BAD, 3.0, target=MAX_ALARMS))
    assert len(made.all()) == MAX_ALARMS
    assert made.find("target-7") is None
    assert made.find(f"target-{MAX_ALARMS}") is not None


def test_codes_of_vehicles_become_ids_that_routes_take() -> None:
    cause = cause_of(event(KIND.LINK, BAD, code='<b onload="x">/../' + "y" * 90, robot=21))
    assert cause is not None
    assert cause.id.startswith("bus-b-onload-x-..-yyy")
    assert cause.id.endswith("y-21")
    assert re.fullmatch(ALARM_ID, cause.id)


# ---------------------------------------------------------------------------- over HTTP


@pytest.fixture
def stage() -> Stage:
    return Stage()


async def fly(stage: Stage) -> None:
    await stage.service.create(REQUEST, "operator")
    await stage.service.start("m1", "operator")
    await eventually(lambda: stage.service.snapshot("m1") is not None)


@pytest_asyncio.fixture
async def client(stage: Stage) -> AsyncIterator[httpx.AsyncClient]:
    async with client_of(stage.app(), stage) as client:
        await fly(stage)
        yield client


@pytest.mark.asyncio
async def test_alarms_are_listed_in_pages(client: httpx.AsyncClient, stage: Stage) -> None:
    for target in (121, 122, 123):
        stage.planners[0].event(KIND.ALARM, Severity.ALARM, "Lost.", target=target)
    page = (await client.get(f"{MISSION}/alarms", params={"limit": 2})).json()
    assert [alarm["id"] for alarm in page["alarms"]] == ["target-121", "target-122"]
    rest = (await client.get(f"{MISSION}/alarms", params={"after": page["next_after"]})).json()
    assert [alarm["id"] for alarm in rest["alarms"]] == ["target-123"]
    assert (await client.get(f"{MISSION}/alarms", params={"after": 3})).json() == {
        "alarms": [],
        "next_after": 3,
    }


@pytest.mark.asyncio
async def test_an_acknowledgement_is_kept_once_and_attributed(
    client: httpx.AsyncClient, stage: Stage
) -> None:
    stage.planners[0].event(KIND.LINK, BAD, "Cut off.", robot=31, link="jammed")
    url = f"{MISSION}/alarms/link-31/acknowledge"
    first = (await client.post(url)).json()
    assert first["acknowledged"]["by"] == "operator"
    again = (await client.post(url)).json()
    assert again["acknowledged"] == first["acknowledged"]
    await stage.service.comment("m1", "A commit flushes what was told before.", "operator")
    journal = stage.service.chronicle.journal
    entries = await journal.read("m1", (EntryKind.EVENT,))
    noted = [entry for entry in entries if "acknowledged" in entry.data["data"]]
    assert [entry.author for entry in noted] == ["operator"]
    assert noted[0].data["text"] == "Operator acknowledged: Robot 31 is cut off."


@pytest.mark.asyncio
@pytest.mark.parametrize(
    ("path", "code"),
    [
        (f"{MISSION}/alarms/link-99/acknowledge", "alarm_unknown"),
        ("/api/v1/missions/m9/alarms/link-31/acknowledge", "mission_unknown"),
    ],
)
async def test_unknown_alarms_are_not_found(
    client: httpx.AsyncClient, path: str, code: str
) -> None:
    answer = await client.post(path)
    assert answer.status_code == 404
    assert answer.json()["error"]["code"] == code


@pytest.mark.asyncio
async def test_alarms_and_acknowledgements_outlast_the_server(stage: Stage) -> None:
    async with client_of(stage.app(), stage) as client:
        await fly(stage)
        stage.planners[0].event(KIND.LINK, BAD, "Cut off.", robot=31, link="jammed")
        stage.planners[0].event(KIND.ALARM, Severity.ALARM, "Lost.", target=122)
        await client.post(f"{MISSION}/alarms/link-31/acknowledge")
    again = Stage()
    journal = DatabaseJournal(Store(f"sqlite:///{stage.folder / 'journal.db'}"))
    again.service = StagedService(ScriptedCatalogue(), again.planner, again.world, journal)
    async with client_of(again.app(), again) as client:
        alarms = (await client.get(f"{MISSION}/alarms")).json()["alarms"]
    assert [alarm["id"] for alarm in alarms] == ["link-31", "target-122"]
    assert alarms[0]["acknowledged"]["by"] == "operator"
    assert alarms[1]["acknowledged"] is None
    assert not any(alarm["active"] for alarm in alarms)  # the mission is over


@pytest.mark.asyncio
async def test_a_mission_tells_its_gate(client: httpx.AsyncClient) -> None:
    assert (await client.get(MISSION)).json()["gate"] == "auto"
    asked = {"scenario": "scripted", "gate": "confirm"}
    made = await client.post("/api/v1/missions", json=asked)
    assert made.json()["gate"] == "confirm"


@pytest.mark.asyncio
async def test_an_interruption_is_told_of_in_the_time_at_which_the_mission_goes_on() -> None:
    """It is told before the first picture; at a time of zero it would be over at once."""
    stage = Stage()
    async with stage.service:
        await stage.service.create(REQUEST, "operator")
        (made,) = stage.service.records()
        core = MissionCore(library.load("ablation").mission_setup())
        known = Revived(
            id="m1",
            definition=made.definition,
            state=MissionState.HELD,
            reason="",
            created_at=made.created_at,
            events=1,
            samples=1,
            comments=(),
            decisions=(),
            alarms=book(jammed(364.5)),
            result=None,
            remains=Remains(made.definition, replace(core.checkpoint(), time_s=365.0)),
        )
        record = MissionRecord.revive(known, stage.service.chronicle)
        record.report(KIND.HOLD, BAD, "The server was interrupted.", "server")
        record.receive(frame(message(365.1)))
        found = {alarm.id: alarm for alarm in record.alarms.all()}
        assert found["interruption"].active
        assert found["interruption"].since_s == 365.0
        assert found["link-31"].active
