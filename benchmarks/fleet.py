"""Real processes of the product, started, watched and ended together.

Every process writes into its own log, kept in memory; whoever starts one waits for the line that
says it is ready. Nothing outlives the fleet.
"""

import asyncio
import os
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

ROOT = Path(__file__).resolve().parents[1]
FALCONER = (sys.executable, "-m", "server.cli")
READY_S = 120.0
"""A loaded machine needs its time to import everything."""

GRACE_S = 20.0
"""A process that ends in order still has something to say; then it is ended by force."""

KEPT_LINES = 500


class FleetError(Exception):
    """Raised when a process ends, or is not ready in time; shows its log."""


@dataclass
class Running:
    """One process and what it has said."""

    name: str
    process: asyncio.subprocess.Process
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=KEPT_LINES))
    said: asyncio.Event = field(default_factory=asyncio.Event)
    hear: Callable[[str], None] | None = None
    """Takes every line, where somebody listens."""

    reading: asyncio.Task[None] | None = None

    @property
    def log(self) -> str:
        """All that it has said."""
        return "\n".join(self.lines)

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self.process.returncode is None

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self.process.send_signal(number)

    async def end(self, number: signal.Signals = signal.SIGTERM) -> int:
        """End it and return its exit code; by force when it takes too long."""
        if self.alive:
            self.process.send_signal(number)
        try:
            async with asyncio.timeout(GRACE_S):
                await self.process.wait()
        except TimeoutError:
            self.process.kill()
        code = await self.process.wait()
        if self.reading is not None:
            await self.reading
        return code

    async def until_said(self, words: str, patience_s: float = READY_S) -> None:
        """Wait until a line with these words is in its log.

        Raises:
            FleetError: It ends before, or does not say so in time.
        """
        try:
            async with asyncio.timeout(patience_s):
                while words not in self.log:
                    self.said.clear()
                    if self.reading is None or self.reading.done():
                        raise FleetError(f"{self.name} has ended:\n{self.log}")
                    await self.said.wait()
        except TimeoutError:
            raise FleetError(f"{self.name} did not say {words!r}:\n{self.log}") from None

    async def read(self) -> None:
        """Take its lines until it ends."""
        assert self.process.stdout is not None
        async for line in self.process.stdout:
            self.lines.append(line.decode(errors="replace").rstrip())
            if self.hear is not None:
                self.hear(self.lines[-1])
            self.said.set()
        self.said.set()


class Fleet:
    """Owner of processes: `async with`, which ends them all, the youngest first."""

    def __init__(self) -> None:
        self._running: list[Running] = []

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for running in self._running:
            if running.alive:
                running.send(signal.SIGCONT)
        await asyncio.gather(*(running.end() for running in reversed(self._running)))

    async def start(
        self,
        name: str,
        command: Sequence[str],
        ready: str | None = None,
        environment: Mapping[str, str] | None = None,
        hear: Callable[[str], None] | None = None,
    ) -> Running:
        """Start a process and wait for the words that say it is ready, if there are any."""
        process = await asyncio.create_subprocess_exec(
            *command,
            cwd=ROOT,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
            start_new_session=True,
        )
        running = Running(name, process, hear=hear)
        running.reading = asyncio.create_task(running.read())
        self._running.append(running)
        if ready is not None:
            await running.until_said(ready)
        return running


@dataclass(frozen=True)
class Autopilot:
    """One simulated autopilot and the robot it is."""

    robot_id: int
    kind: str
    """ardupilot or px4."""

    port: int
    """UDP port that it listens on; its bridge and any ground station speak to it there."""

    system: int
    home: tuple[float, float]
    altitude_m: float
    extra: tuple[str, ...] = ()

    def command(self) -> tuple[str, ...]:
        """Return the command that flies it."""
        return (
            *(*FALCONER, "vehicle", "sim-autopilot", "--connect", f"udpin:127.0.0.1:{self.port}"),
            *("--autopilot", self.kind, "--system", str(self.system), "--start", "airborne"),
            *(f"--home={self.home[0]},{self.home[1]}", "--altitude", str(self.altitude_m)),
            *self.extra,
        )

    def bridge(
        self, bus: str, scenario: str, *extra: str, port: int | None = None
    ) -> tuple[str, ...]:
        """Return the command of its bridge, which reaches it by another port where one is given."""
        link = f"udpout:127.0.0.1:{self.port if port is None else port}"
        return (
            *(*FALCONER, "vehicle", "mavlink", "--robot", str(self.robot_id), "--connect", link),
            *("--autopilot", self.kind, "--system", str(self.system), "--scenario", scenario),
            *("--datum", "47.0,8.0,400", "--senses", "world", "--zenoh-connect", bus),
            *extra,
        )


def world(scenario: str, bus: str, external: Sequence[int]) -> tuple[str, ...]:
    """Return the command of a simulated world where others fly some of the robots."""
    chosen = (word for robot_id in external for word in ("--external", str(robot_id)))
    return (*FALCONER, "sim", scenario, "--connect", bus, *chosen)


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return a port of this machine that nobody uses at the moment."""
    with socket.socket(socket.AF_INET, kind) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])
