"""The inbox: newest state wins, events wait in order, memory is bounded, one wake-up."""

import asyncio
from threading import Thread

import pytest

from vehicles.inbox import Inbox, Sample, SampleKind
from vehicles.keys import TeamKeys
from vehicles.messages import MAX_PAYLOAD

STATE, OTHER = "falconer/red/robots/1/state", "falconer/red/robots/2/state"
EVENTS = "falconer/red/robots/1/events"
KEYS = TeamKeys("red")


def test_the_newest_state_wins_and_events_wait_in_order() -> None:
    inbox = Inbox(KEYS.delivery)
    for number in range(100):
        inbox.offer(Sample(STATE, b"%d" % number))
        inbox.offer(Sample(EVENTS, b"%d" % number))
    inbox.offer(Sample(OTHER, b"x"))
    waiting = inbox.drain()
    assert [sample.payload for sample in waiting[:100]] == [b"%d" % n for n in range(100)]
    assert waiting[100:] == (Sample(STATE, b"99"), Sample(OTHER, b"x"))
    assert inbox.drain() == ()
    assert inbox.dropped == 0


def test_states_come_out_in_the_order_of_their_newest() -> None:
    inbox = Inbox(KEYS.delivery)
    for key in (STATE, OTHER, STATE):
        inbox.offer(Sample(key, b""))
    assert [sample.key for sample in inbox.drain()] == [OTHER, STATE]


def test_a_token_that_goes_and_comes_is_told_in_full() -> None:
    inbox = Inbox(KEYS.delivery)
    kinds = (SampleKind.PUT, SampleKind.DELETE, SampleKind.PUT)
    for kind in kinds:
        inbox.offer(Sample("falconer/red/alive/1", b"", kind))
    assert tuple(sample.kind for sample in inbox.drain()) == kinds


def test_a_flood_is_bounded_and_counted() -> None:
    inbox = Inbox(KEYS.delivery, max_events=10, max_keys=3)
    for number in range(25):
        inbox.offer(Sample(EVENTS, b"%d" % number))
        inbox.offer(Sample(f"falconer/red/robots/{number}/state", b""))
    waiting = inbox.drain()
    assert [s.payload for s in waiting if s.key == EVENTS] == [b"%d" % n for n in range(10)]
    assert len(waiting) == 13
    assert inbox.dropped == 15 + 22
    inbox.offer(Sample(STATE, b" " * (MAX_PAYLOAD + 1)))
    assert inbox.drain() == ()
    assert inbox.dropped == 15 + 22 + 1
    inbox.offer(Sample(EVENTS, b"again"))
    assert len(inbox.drain()) == 1


def test_one_key_cannot_crowd_the_others_out() -> None:
    other = "falconer/red/robots/2/events"
    inbox = Inbox(KEYS.delivery, max_events=100, max_per_key=10)
    for number in range(50):
        inbox.offer(Sample(EVENTS, b"%d" % number))
    inbox.offer(Sample(other, b"heard"))
    assert [s.payload for s in inbox.drain()] == [*(b"%d" % n for n in range(10)), b"heard"]
    assert inbox.dropped == 40
    inbox.offer(Sample(EVENTS, b"again"))
    assert [s.payload for s in inbox.drain()] == [b"again"]


def test_a_reader_takes_some_of_each_key_at_a_time_and_loses_none() -> None:
    other = "falconer/red/robots/2/events"
    inbox = Inbox(KEYS.delivery, per_drain=4)
    for number in range(10):
        inbox.offer(Sample(EVENTS, b"%d" % number))
    inbox.offer(Sample(other, b"other"))
    inbox.offer(Sample(STATE, b"state"))
    first = [s.payload for s in inbox.drain()]
    assert first == [b"0", b"1", b"2", b"3", b"other", b"state"]
    inbox.offer(Sample(EVENTS, b"10"))
    rest = [[s.payload for s in inbox.drain()] for _ in range(3)]
    assert rest == [[b"4", b"5", b"6", b"7"], [b"8", b"9", b"10"], []]
    assert inbox.dropped == 0


@pytest.mark.asyncio
async def test_what_is_left_wakes_again() -> None:
    taken: list[bytes] = []
    inbox = Inbox(
        KEYS.delivery, lambda: taken.extend(s.payload for s in inbox.drain()), per_drain=2
    )
    inbox.attach()
    for number in range(5):
        inbox.offer(Sample(EVENTS, b"%d" % number))
    for _ in range(5):
        await asyncio.sleep(0)
    assert taken == [b"%d" % n for n in range(5)]


async def wakes_of(threads: int, offers: int) -> tuple[int, int]:
    """Return how often the loop was woken before it drained, and how many samples waited."""
    wakes = 0

    def wake() -> None:
        nonlocal wakes
        wakes += 1

    inbox = Inbox(KEYS.delivery, wake)
    inbox.attach()

    def offer() -> None:
        for _ in range(offers):
            inbox.offer(Sample(EVENTS, b""))

    workers = [Thread(target=offer) for _ in range(threads)]
    for worker in workers:
        worker.start()
    for worker in workers:
        await asyncio.to_thread(worker.join)
    await asyncio.sleep(0)
    first = wakes
    waiting = len(inbox.drain())
    inbox.offer(Sample(EVENTS, b""))
    await asyncio.sleep(0)
    assert wakes == first + 1, "drained, it wakes again"
    return first, waiting


@pytest.mark.asyncio
async def test_however_much_arrives_from_many_threads_the_loop_is_woken_once() -> None:
    assert await wakes_of(threads=4, offers=500) == (1, 2000)


def test_a_closed_loop_is_not_minded() -> None:
    woken: list[None] = []
    inbox = Inbox(KEYS.delivery, lambda: woken.append(None))

    async def attach() -> None:
        inbox.attach()

    asyncio.run(attach())
    inbox.offer(Sample(STATE, b""))
    assert woken == []
    assert len(inbox.drain()) == 1


def test_it_is_attached_on_a_loop() -> None:
    with pytest.raises(RuntimeError, match="no running event loop"):
        Inbox(KEYS.delivery).attach()
