"""What the bus costs: a team's messages between processes, and how late each arrives.

    python -m benchmarks.bus [--robots 50] [--hz 50] [--seconds 10] [--processes 5] [--json FILE]

A planner's session is the router; every robot is a client session of its own, spread over
processes of this machine. Each robot sends its state, the planner a setpoint to each robot, both at
the rate asked for, all encoded and checked as in flight; once a second each robot sends an event.
Latency is from before encoding to after decoding, by the clock all processes of a machine share.
Messages that did not arrive are told from those that a newer one overtook in the inbox.
"""

import argparse
import asyncio
import json
import os
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.report import machine
from solver.observations import RobotState
from solver.setpoints import Setpoint
from vehicles import messages as wire
from vehicles.inbox import Inbox, Sample
from vehicles.keys import TeamKeys, Topic
from vehicles.reporter import Reporter
from vehicles.translation import Sender, setpoint_message
from vehicles.zenoh_bus import ZenohBus
from vehicles.zenoh_settings import ZenohMode, ZenohSettings

ROOT = Path(__file__).resolve().parents[1]
KEYS = TeamKeys("bench")
WARM_UP_S = 1.0
LOOK_S = 0.02
LAST_S = 30.0
"""So long the last message of each key is waited for, which nothing replaces."""


@dataclass(slots=True)
class Tally:
    """What one receiver got of each sender."""

    latencies_s: list[float] = field(default_factory=list)
    first: dict[str, int] = field(default_factory=dict)
    last: dict[str, int] = field(default_factory=dict)
    disordered: int = 0

    def take(self, key: str, message: wire.Message) -> None:
        """Count one message."""
        self.latencies_s.append(time.monotonic() - message.stamp_s)
        if message.seq <= self.last.get(key, -1):
            self.disordered += 1
        self.last[key] = message.seq

    def due(self, sent: dict[str, int]) -> int:
        """Return how many were to arrive since the first of each key did."""
        return sum(sent[key] - first for key, first in self.first.items())


@dataclass(frozen=True, slots=True)
class Figures:
    """One direction, or one kind of message."""

    kind: str
    sent: int
    arrived: int
    overtaken: int
    """Left out for a newer one that waited with it."""

    lost: int
    p50_ms: float
    p99_ms: float
    max_ms: float


@dataclass(frozen=True, slots=True)
class Share:
    """What one process of vehicles is to do."""

    endpoint: str
    robot_ids: tuple[int, ...]
    hz: float
    seconds: float


@dataclass(frozen=True, slots=True)
class Report:
    """What one process of vehicles has to tell."""

    cores: float
    sent: dict[str, int]
    latencies_s: list[float]
    first: dict[str, int]
    overtaken: int
    disordered: int


@dataclass(frozen=True, slots=True)
class Result:
    """All figures of one measurement."""

    robots: int
    rows: tuple[Figures, ...]
    disordered: int
    planner_cores: float
    vehicle_cores: float
    """Of all robots together."""

    load: float
    """Of the machine at the end."""


def figures(kind: str, latencies_s: list[float], due: int, conflated: int) -> Figures:
    """Return the figures of a kind of message."""
    if not latencies_s:
        raise RuntimeError(f"no {kind} arrived at all")
    ms = 1e3 * np.asarray(latencies_s)
    p50, p99 = np.percentile(ms, [50, 99])
    missing = due - len(ms)
    return Figures(
        kind,
        due,
        len(ms),
        overtaken=min(missing, conflated),
        lost=missing - min(missing, conflated),
        p50_ms=float(p50),
        p99_ms=float(p99),
        max_ms=float(ms.max()),
    )


class Counted:
    """An inbox that is drained as soon as the loop is woken, and what came of it."""

    def __init__(self, decode: Callable[[str, bytes], wire.Message]) -> None:
        self.tally = Tally()
        self.offered = 0
        self._begun: dict[str, bytes] = {}
        """The first message of each key, which a newer one may replace before it is read."""

        self._decode = decode
        self._inbox = Inbox(KEYS.delivery, self._drain)

    def attach(self) -> None:
        """Tie it to the running loop."""
        self._inbox.attach()

    def offer(self, sample: Sample) -> None:
        """Count what Zenoh delivers before the inbox conflates it."""
        self.offered += 1
        self._begun.setdefault(sample.key, sample.payload)
        self._inbox.offer(sample)

    @property
    def overtaken(self) -> int:
        """How many samples a newer one replaced."""
        return self.offered - len(self.tally.latencies_s)

    async def until_last(self, sent: dict[str, int]) -> None:
        """Wait for the last of so many messages of each key, or as long as one waits for it."""
        with suppress(TimeoutError):
            async with asyncio.timeout(LAST_S):
                last = self.tally.last
                while any(last.get(key, -1) < n - 1 for key, n in sent.items()):  # noqa: ASYNC110
                    await asyncio.sleep(LOOK_S)

    def _drain(self) -> None:
        for sample in self._inbox.drain():
            if sample.key not in self.tally.first:
                first = self._decode(sample.key, self._begun[sample.key])
                self.tally.first[sample.key] = first.seq
            self.tally.take(sample.key, self._decode(sample.key, sample.payload))


async def paced(hz: float, seconds: float, send: Callable[[float], None]) -> None:
    """Call at a rate, drift-free; a late call is made up for."""
    loop = asyncio.get_running_loop()
    start_s = loop.time()
    for number in range(round(hz * seconds)):
        await asyncio.sleep(start_s + number / hz - loop.time())
        send(time.monotonic())


# ---------------------------------------------------------------------- vehicles


async def vehicles(share: Share) -> Report:
    """Be some of the robots; return what was sent, heard and spent."""
    own = [Robot(robot_id, share) for robot_id in share.robot_ids]
    begun = asyncio.Event()
    setpoints: asyncio.Future[int] = asyncio.get_running_loop().create_future()
    async with asyncio.TaskGroup() as group:
        flying = [group.create_task(robot.fly(begun, setpoints)) for robot in own]
        await asyncio.wait_for(asyncio.to_thread(sys.stdin.readline), 120.0)
        cpu_s, wall_s = time.process_time(), time.monotonic()
        begun.set()
        setpoints.set_result(int(await asyncio.to_thread(sys.stdin.readline)))
        await asyncio.wait(flying)
        cores = (time.process_time() - cpu_s) / (time.monotonic() - wall_s)
    return Report(
        cores=cores,
        sent={key: count for robot in own for key, count in robot.sent().items()},
        latencies_s=[each for robot in own for each in robot.heard.tally.latencies_s],
        first={key: seq for robot in own for key, seq in robot.heard.tally.first.items()},
        overtaken=sum(robot.heard.overtaken for robot in own),
        disordered=sum(robot.heard.tally.disordered for robot in own),
    )


class Robot:
    """One robot: a session of its own that says its state and hears its setpoint."""

    def __init__(self, robot_id: int, share: Share) -> None:
        self._share, self._id = share, robot_id
        self.heard = Counted(lambda _, payload: wire.decode(wire.Setpoint, payload))
        self._counts = {Topic.STATE: 0, Topic.EVENTS: 0}

    def sent(self) -> dict[str, int]:
        """Return how many messages were sent on each key."""
        return {KEYS.robot(self._id, topic): count for topic, count in self._counts.items()}

    async def fly(self, begun: asyncio.Event, setpoints: asyncio.Future[int]) -> None:
        """Say and hear for the time asked for, and until the last of so many setpoints has come."""
        share = self._share
        settings = ZenohSettings(connect=(share.endpoint,))
        async with ZenohBus(settings, KEYS.delivery) as bus:
            reporter = Reporter(bus, KEYS, self._id, "b", 1000)
            notice = partial(wire.NoticePart, code="bench", text="a second more")
            await bus.subscribe(KEYS.robot(self._id, Topic.SETPOINT), self.heard)
            await bus.announce(KEYS.alive(self._id))
            await begun.wait()

            def send(now_s: float) -> None:
                state = RobotState(self._id, (1.25, -3.5), (0.25, 0.125), 1.5, sensing_failed=False)
                reporter.state(state, wire.Mode.FLYING, now_s)
                self._counts[Topic.STATE] += 1
                if self._counts[Topic.STATE] % round(share.hz) == 0:
                    reporter.note(now_s, notice)
                    reporter.flush(now_s)
                    self._counts[Topic.EVENTS] += 1

            # Robots are not in step with each other.
            await asyncio.sleep((self._id * 0.618) % 1.0 / share.hz)
            await paced(share.hz, WARM_UP_S + share.seconds, send)
            own = KEYS.robot(self._id, Topic.SETPOINT)
            await self.heard.until_last({own: await asyncio.shield(setpoints)})


# ---------------------------------------------------------------------- planner


def decoded(key: str, payload: bytes) -> wire.Message:
    """Return a message of a robot."""
    address = KEYS.parse(key)
    if address is not None and address.topic is Topic.EVENTS:
        return wire.decode(wire.Event, payload)
    return wire.decode(wire.State, payload)


async def measure(robots: int, hz: float, seconds: float, processes: int) -> Result:
    """Run the planner's side and the processes of the robots; return all figures."""
    ids = list(range(robots))
    states, events = Counted(decoded), Counted(decoded)
    async with ZenohBus(
        ZenohSettings(mode=ZenohMode.ROUTER, listen=("tcp/127.0.0.1:0",)), KEYS.delivery
    ) as bus:
        await bus.subscribe(KEYS.robot(None, Topic.STATE), states)
        await bus.subscribe(KEYS.robot(None, Topic.EVENTS), events)
        shares = [
            Share(bus.endpoints[0], tuple(ids[number::processes]), hz, seconds)
            for number in range(processes)
        ]
        started = [await _start(share) for share in shares]
        try:
            while len(await bus.present(KEYS.alive(None))) < robots:  # noqa: ASYNC110
                await asyncio.sleep(0.1)
            cpu_s, wall_s = time.process_time(), time.monotonic()
            sender, sent = Sender("p"), 0

            def send(_: float) -> None:
                nonlocal sent
                for robot_id in ids:
                    setpoint = Setpoint(robot_id, (0.5, -0.5), (1.0, 2.0), 1.5, 0.5)
                    header = sender.header(KEYS.robot(robot_id, Topic.SETPOINT), time.monotonic())
                    message = setpoint_message(header, setpoint, "bench")
                    bus.publish(KEYS.robot(robot_id, Topic.SETPOINT), wire.encode(message))
                sent += 1

            for process in started:
                assert process.stdin is not None
                process.stdin.write(b"go\n")
                await process.stdin.drain()
            await paced(hz, WARM_UP_S + seconds, send)
            cores = (time.process_time() - cpu_s) / (time.monotonic() - wall_s)
            # Robots send as often, with an event a second, and stay until all of it has come.
            await states.until_last({KEYS.robot(i, Topic.STATE): sent for i in ids})
            await events.until_last({KEYS.robot(i, Topic.EVENTS): sent // round(hz) for i in ids})
            last = b"%d\n" % sent
            reports = await asyncio.gather(*(process.communicate(last) for process in started))
            told = [Report(**json.loads(out)) for out, _ in reports]
        finally:
            for process in started:
                if process.returncode is None:
                    process.kill()
    return _summed(told, states, events, sent, cores)


async def _start(share: Share) -> asyncio.subprocess.Process:
    return await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "benchmarks.bus", "--share", json.dumps(asdict(share))),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        cwd=ROOT,
    )


def _summed(
    told: list[Report], states: Counted, events: Counted, sent: int, cores: float
) -> Result:
    spoken = {key: count for report in told for key, count in report.sent.items()}
    latencies_s = [each for report in told for each in report.latencies_s]
    due = sum(sent - first for report in told for first in report.first.values())
    overtaken = sum(report.overtaken for report in told)
    return Result(
        robots=sum(key.endswith("/state") for key in spoken),
        rows=(
            figures("state", states.tally.latencies_s, states.tally.due(spoken), states.overtaken),
            figures("event", events.tally.latencies_s, events.tally.due(spoken), 0),
            figures("setpoint", latencies_s, due, overtaken),
        ),
        disordered=sum(
            (report.disordered for report in told),
            states.tally.disordered + events.tally.disordered,
        ),
        planner_cores=cores,
        vehicle_cores=sum(report.cores for report in told),
        load=os.getloadavg()[0],
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--hz", type=float, default=50.0)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--processes", type=int, default=5)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--share", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.share is not None:
        share = Share(**json.loads(asked.share))
        sys.stdout.write(json.dumps(asdict(asyncio.run(vehicles(share)))))
        return 0
    found = asyncio.run(measure(asked.robots, asked.hz, asked.seconds, asked.processes))
    print(f"{found.robots} robots at {asked.hz:g} Hz for {asked.seconds:g} s, on {machine()}")
    print("| message | sent | arrived | overtaken | lost | p50 ms | p99 ms | max ms |")
    print("|---|---|---|---|---|---|---|---|")
    for row in found.rows:
        counts = f"{row.sent} | {row.arrived} | {row.overtaken} | {row.lost}"
        print(f"| {row.kind} | {counts} | {row.p50_ms:.2f} | {row.p99_ms:.2f} | {row.max_ms:.1f} |")
    print(
        f"processor: planner {100.0 * found.planner_cores:.0f} % of a core, each robot "
        f"{100.0 * found.vehicle_cores / found.robots:.2f} %; load at the end {found.load:.1f}; "
        f"out of order {found.disordered}"
    )
    if asked.json is not None:
        asked.json.write_text(json.dumps(asdict(found), indent=2))
    return 0


if __name__ == "__main__":
    sys.exit(main())
