"""What an agent tells, and what it cannot say."""

import json
from functools import partial

import pytest

from tests.vehicles.buses import KEYS
from vehicles import messages as wire
from vehicles.inbox import Inbox
from vehicles.keys import Topic
from vehicles.local_bus import LocalBus, LocalHub
from vehicles.reporter import Reporter


@pytest.mark.asyncio
async def test_an_event_that_cannot_be_said_is_counted_and_the_others_are_told() -> None:
    async with LocalBus(LocalHub()) as bus:
        inbox = Inbox(KEYS.delivery)
        await bus.subscribe(KEYS.robot(21, Topic.EVENTS), inbox)
        reporter = Reporter(bus, KEYS, 21, "b1", max_events=10)
        for text in ("first", "far too long" * 100, "last"):
            reporter.note(1.0, partial(wire.NoticePart, code="warning", text=text))
        reporter.flush(3.0)
        told = [json.loads(sample.payload) for sample in inbox.drain()]
    assert [message["event"]["text"] for message in told] == ["first", "last"]
    assert [message["age_s"] for message in told] == [2.0, 2.0]
    assert reporter.unsaid == 1
