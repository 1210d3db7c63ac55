"""The figures of the bus: short runs of both programs, between real processes."""

import asyncio

import numpy as np
import pytest

from benchmarks import bus, reaction
from benchmarks.bus import Counted, decoded, figures
from solver.observations import RobotState
from tests.patience import PATIENCE_S
from vehicles import messages as wire
from vehicles import translation
from vehicles.inbox import Sample
from vehicles.keys import Topic


def said(seq: int) -> wire.State:
    """Return what robot 3 says at one moment."""
    state = RobotState(3, (0.0, 0.0), (0.0, 0.0), 1.0, sensing_failed=False)
    header = {"v": 1, "boot": "b", "seq": seq, "stamp_s": 0.0}
    return translation.state_message(header, state, wire.Mode.FLYING)


def test_missing_messages_are_told_from_overtaken_ones() -> None:
    found = figures("state", [0.001, 0.003, 0.002], due=10, conflated=4)
    assert (found.arrived, found.overtaken, found.lost) == (3, 4, 3)
    assert found.p50_ms == pytest.approx(2.0)
    assert found.max_ms == pytest.approx(3.0)
    with pytest.raises(RuntimeError, match="no state arrived"):
        figures("state", [], due=10, conflated=0)


@pytest.mark.asyncio
async def test_a_message_out_of_order_is_noticed() -> None:
    counted, key = Counted(decoded), bus.KEYS.robot(3, Topic.STATE)
    counted.attach()
    for seq in (4, 6, 5):
        counted.offer(Sample(key, wire.encode(said(seq))))
        await asyncio.sleep(0)
    assert counted.tally.disordered == 1
    assert counted.tally.due({key: 7}) == 3
    assert counted.overtaken == 0


@pytest.mark.asyncio
async def test_a_first_message_that_is_replaced_before_it_is_read_counts() -> None:
    counted, key = Counted(decoded), bus.KEYS.robot(3, Topic.STATE)
    counted.attach()
    for seq in range(3):
        counted.offer(Sample(key, wire.encode(said(seq))))
    await counted.until_last({key: 3})
    assert counted.tally.due({key: 3}) == 3
    assert counted.overtaken == 2


@pytest.mark.process
@pytest.mark.asyncio
async def test_nothing_is_lost_between_processes() -> None:
    async with asyncio.timeout(PATIENCE_S):
        found = await bus.measure(robots=4, hz=20.0, seconds=1.0, processes=2)
    assert [row.kind for row in found.rows] == ["state", "event", "setpoint"]
    assert [row.lost for row in found.rows] == [0, 0, 0]
    assert found.rows[0].sent == 4 * 40
    assert found.disordered == 0


@pytest.mark.process
@pytest.mark.asyncio
async def test_a_detection_turns_its_robot() -> None:
    """How soon is for the benchmark to say: a machine that tests is busy."""
    latencies_s = await reaction.measure(robots=2, seconds=3.0, seed=1, least=3)
    assert len(latencies_s) >= 3
    assert np.isfinite(latencies_s).all()
    assert np.min(latencies_s) > 0.0
