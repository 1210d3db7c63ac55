"""A planner that says nothing any more is told of, once, and so is its return."""

import time
from collections.abc import AsyncIterator

import pytest
import pytest_asyncio

from server.api.alarm_models import Alarm
from server.api.models import MissionRequest
from server.api.record import MissionRecord
from server.api.silence import SILENT_S, SilenceWatch, silence_s
from server.encoding import MissionState
from server.live.channel import frame
from tests.console.messages import message
from tests.console.panels.test_library import mission
from tests.server.api.serving import Stage
from tests.server.waiting import eventually


class Flight:
    """A mission whose planner speaks when the test says so, by a clock of the test's."""

    def __init__(self, stage: Stage) -> None:
        self.stage, self.now_s = stage, 1000.0
        self.watch = SilenceWatch(stage.service.records, lambda: self.now_s)

    @property
    def record(self) -> MissionRecord:
        (record,) = self.stage.service.records()
        return record

    def speak(self) -> None:
        told = message(self.now_s) | {"state": "running", "stamp_s": self.now_s}
        self.record.receive(frame(told))

    def look(self, *after_s: float) -> None:
        for each in after_s:
            self.now_s += each
            self.watch.look()

    @property
    def alarms(self) -> list[Alarm]:
        return [a for a in self.stage.service.watch.alarms("m1") if a.id == "silence"]


@pytest_asyncio.fixture(name="flight")
async def _flight() -> AsyncIterator[Flight]:
    stage = Stage(period_s=1000.0)  # it says nothing by itself
    async with stage.service:
        await stage.service.create(MissionRequest(scenario="scripted"), "operator")
        await stage.service.start("m1", "operator")
        flight = Flight(stage)
        await eventually(lambda: flight.record.host is not None)
        yield flight


@pytest.mark.asyncio
async def test_a_silent_planner_is_an_alarm_until_it_speaks_again(flight: Flight) -> None:
    flight.look(0.0)
    flight.speak()
    flight.look(0.5, SILENT_S, 0.5, 0.5, 5.0)
    (alarm,) = flight.alarms
    assert alarm.active
    assert alarm.severity == "alarm"
    assert alarm.title == "The planner is silent"
    assert alarm.text == "The planner has said nothing for 3 s; its vehicles hold."
    flight.speak()
    flight.look(0.1, 0.1)
    (alarm,) = flight.alarms
    assert not alarm.active
    assert alarm.count == 1
    said = [event["text"] for event in flight.record.recent_events(5)]
    assert "The planner speaks again, after 8 s." in said


@pytest.mark.asyncio
async def test_one_look_is_not_enough(flight: Flight) -> None:
    """Who was stopped himself finds everybody silent at first."""
    flight.look(0.0)
    flight.speak()
    flight.look(60.0)
    flight.speak()
    flight.look(0.5, 0.5)
    assert flight.alarms == []


@pytest.mark.asyncio
async def test_who_has_not_spoken_yet_is_not_silent(flight: Flight) -> None:
    """The last picture may be that of a process before; bringing one up takes a while."""
    flight.speak()
    flight.now_s += 30.0
    flight.look(0.0, 0.5, 0.5)
    assert flight.alarms == []


@pytest.mark.parametrize(
    ("state", "silent"),
    [
        (MissionState.RUNNING, True),
        (MissionState.HELD, True),
        (MissionState.PAUSED, False),  # mission time stands still
        (MissionState.ENDED, False),
    ],
)
def test_only_who_should_speak_is_silent(state: MissionState, silent: bool) -> None:
    old = message(30.0) | {"stamp_s": time.monotonic() - 60.0}
    assert (silence_s(mission(1, state=state), old) >= 60.0) == silent
    assert silence_s(mission(1, state=state), None) == 0.0
    assert silence_s(mission(1, state=state), message(30.0) | {"stamp_s": None}) == 0.0
    assert silence_s(mission(1, state=state, clock="replay"), old) == 0.0
    ahead = message(30.0) | {"stamp_s": time.monotonic() + 60.0}  # none is that old
    assert silence_s(mission(1, state=state), ahead) == 0.0
