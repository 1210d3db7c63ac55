"""What the server tells people: stream, alarms and metrics, as one of its clients gets them."""

import asyncio
import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from time import monotonic
from typing import Any

import httpx
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from benchmarks.live import beyond, uncovered
from tests.chaos.clients import asked_of
from tests.chaos.watch import Findings, Invariant
from tests.patience import busy

ALARMS = "alarms"
"""Stands for the kind of what was read from the list of alarms, not from the stream."""

POLL_S = 0.5
AGAIN_S = 0.2
REPORT_S = 45.0
"""A language model's time-out, twice its period and a repair fit in."""

COVERED_S = 2.0
"""Within so much mission time every target has a robot again."""

UNSEEN_S = 1.0
"""Of what a mission was for longer between two snapshots nobody knows."""

KEPT = 5000


class Unreported(AssertionError):
    """Raised when nobody was told of a fault."""


@dataclass(frozen=True)
class Told:
    """Something that people were told."""

    at_s: float
    kind: str
    severity: str
    text: str
    data: dict[str, Any]


Wanted = Callable[[Told], bool]


@dataclass
class Ear:
    """Reads everything, through whatever proxy it is given. Two tasks: `listen` and `poll`."""

    address: str
    headers: dict[str, str]
    findings: Findings
    told: list[Told] = field(default_factory=list)
    snapshot: dict[str, Any] = field(default_factory=dict)
    heard_s: float = 0.0
    """When the newest snapshot came."""

    snapshots: int = 0
    patience_s: float | None = None
    """How long a report is waited for; None as long as it may take here."""

    _bare_s: float | None = None
    """Mission time from which every snapshot showed targets without a robot."""

    _alarms: dict[str, tuple[int, bool, float]] = field(default_factory=dict)
    """By id: how often each was raised, whether it stands, and when it was raised last."""

    @property
    def state(self) -> str:
        """The mission's state, "" where nothing has been heard for a second."""
        fresh = monotonic() - self.heard_s < 1.0 + busy()
        return str(self.snapshot["state"]) if self.snapshot and fresh else ""

    async def listen(self) -> None:
        """Read the stream for ever, again after every end of it."""
        url = self.address.replace("http", "ws", 1) + "/api/v1/missions/m1/stream"
        while True:
            with suppress(OSError, WebSocketException, TimeoutError):
                async with connect(
                    url,
                    additional_headers=self.headers,
                    compression=None,
                    max_size=None,
                    proxy=None,
                ) as stream:
                    async for text in stream:
                        self._take(json.loads(text))
            await asyncio.sleep(AGAIN_S)

    async def poll(self) -> None:
        """Read the alarms for ever."""
        async with self.client() as http:
            while True:
                with suppress(httpx.HTTPError):
                    answer = await http.get("/missions/m1/alarms?limit=500")
                    if answer.is_success:
                        self._compare(answer.json()["alarms"])
                await asyncio.sleep(POLL_S)

    async def dropped(self) -> float:
        """Return how many messages the server says it has refused or dropped."""
        async with self.client("") as http:
            text = (await asked_of(http, "/metrics")).text
        lines = [line for line in text.splitlines() if line.startswith("falconer_dropped_total")]
        return sum(float(line.split()[-1]) for line in lines)

    async def until(self, wanted: Wanted, since_s: float, what: str) -> Told:
        """Wait until people are told. Raises Unreported."""
        patience_s = REPORT_S * busy() if self.patience_s is None else self.patience_s
        while monotonic() < since_s + patience_s:
            for one in reversed(self.told):
                if one.at_s < since_s:
                    break
                if wanted(one):
                    return one
            await asyncio.sleep(0.05)
        raise Unreported(f"{what}: nobody was told within {patience_s:.0f} s")

    def client(self, base: str = "/api/v1") -> httpx.AsyncClient:
        """Return a client of the same server by the same way."""
        return httpx.AsyncClient(
            base_url=self.address + base,
            headers={**self.headers, "accept-encoding": "identity"},
            timeout=10.0,
            trust_env=False,
        )

    def _take(self, said: dict[str, Any]) -> None:
        now_s = monotonic()
        if said["type"] != "snapshot":
            self._note(
                Told(now_s, said["kind"], said["severity"], said["text"], said.get("data") or {})
            )
            return
        before, self.snapshot, self.heard_s = self.snapshot, said, now_s
        self.snapshots += 1
        self.findings.looked(Invariant.BOUNDS)
        for wrong in beyond(said):
            self.findings.broken(Invariant.BOUNDS, wrong, f"tick {said['tick']}: {wrong}")
        self._look_for_cover(said, before.get("time_s", 0.0))

    def _look_for_cover(self, said: dict[str, Any], before_s: float) -> None:
        """Every target has a robot, but for the moment after lost ones came back."""
        bare, time_s = uncovered(said), said["time_s"]
        if not bare or said["state"] != "running":
            self._bare_s = None
        elif self._bare_s is None or not 0.0 <= time_s - before_s <= UNSEEN_S:
            self._bare_s = time_s
        elif time_s - self._bare_s > COVERED_S:
            words = f"targets without a robot for {time_s - self._bare_s:.1f} s: {bare}"
            self.findings.broken(Invariant.BOUNDS, f"{bare}", words)

    def _compare(self, alarms: list[dict[str, Any]]) -> None:
        """Take note of alarms that were raised, raised again, or are over."""
        for alarm in alarms:
            stands = (alarm["count"], alarm["active"], alarm["last_s"])
            if self._alarms.get(alarm["id"]) != stands:
                self._alarms[alarm["id"]] = stands
                severity = alarm["severity"] if alarm["active"] else "info"
                self._note(Told(monotonic(), ALARMS, severity, alarm["text"], alarm))

    def _note(self, told: Told) -> None:
        self.told.append(told)
        del self.told[:-KEPT]


def alarmed(alarm_id: str) -> Wanted:
    """Return what recognises an alarm that stands."""
    return lambda one: one.kind == ALARMS and one.data["id"] == alarm_id and one.data["active"]


def over(alarm_id: str) -> Wanted:
    """Return what recognises an alarm that is over."""
    return lambda one: one.kind == ALARMS and one.data["id"] == alarm_id and not one.data["active"]


def linked(robot: int, *links: str) -> Wanted:
    """Return what recognises the news that a robot's link is so."""
    return lambda one: (
        one.data.get("robot") == robot
        and (
            one.data.get("link") in links
            or (one.kind == ALARMS and one.data["id"] == f"link-{robot}" and one.data["active"])
        )
    )


def noticed(code: str, robot: int | None = None, words: str = "") -> Wanted:
    """Return what recognises a robot's own notice."""
    return lambda one: (
        one.data.get("code") == code
        and words in one.text
        and (robot is None or one.data.get("robot") == robot)
    )
