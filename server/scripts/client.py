"""Steers one scripted mission over REST, whatever happens to the server meanwhile.

The server, its model or its vehicles may go and come back: a request that fails is tried again
until the script's patience ends, a mission that came back held is resumed, one whose planner died
is started again, and nothing is said twice.
"""

import asyncio
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any, Final

import httpx

from server.scripts.script import Bound, Do, Say, Script

LOOK_S: Final = 0.25
"""Between two looks at the mission."""

REQUEST_S: Final = 10.0

API: Final = "/api/v1"


class ScriptFailed(Exception):
    """Raised when a script cannot go on: the server refused, or patience ended."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was expected."""

    what: str
    expected: str
    found: Any
    passed: bool


@dataclass(slots=True)
class Verdict:
    """What a scripted mission came to."""

    script: str
    mission: str | None = None
    checks: list[Check] = field(default_factory=list)
    interruptions: int = 0
    """Times that the server was away, or the mission had to be set going again."""

    result: dict[str, Any] | None = None

    @property
    def passed(self) -> bool:
        """Whether everything that was expected was found."""
        return self.result is not None and all(check.passed for check in self.checks)


class ScriptClient:
    """Owner of one scripted mission, seen from outside."""

    def __init__(self, script: Script, client: httpx.AsyncClient, tell: Callable[[str], None]):
        self._script = script
        self._client = client
        self._tell = tell
        self._verdict = Verdict(script.name)
        self._actions = deque(sorted(script.actions, key=lambda action: action.at_s))
        self._said: dict[str, Say] = {}
        """What was said, by the comment's id."""

        self._until_s = script.until_s
        self._holding = False
        self._paused = _Pauses()
        self._away = False
        self._broken = False
        """From the first sign of an interruption until the mission flies again."""

        self._told = set[str]()
        """What was said of this interruption."""

    async def run(self) -> Verdict:
        """Fly the script and return the verdict. Raises ScriptFailed."""
        try:
            async with asyncio.timeout(self._script.patience_s):
                mission = await self._until_done(self._create)
                self._verdict.mission = mission
                await self._until_done(lambda: self._fly(mission))
                await self._until_done(lambda: self._judge(mission))
        except TimeoutError:
            raise ScriptFailed(
                f"{self._script.name}: not done after {self._script.patience_s:g} s"
            ) from None
        return self._verdict

    async def _until_done(self, act: Callable[[], Any]) -> Any:
        """Try again while the server is away. Raises ScriptFailed where it refuses."""
        while True:
            try:
                done = await act()
            except (httpx.TransportError, _ServerAway) as error:
                if not self._away:
                    self._away = True
                    self._interrupted(f"the server is away: {str(error) or type(error).__name__}")
                await asyncio.sleep(LOOK_S)
                continue
            except _NotYet as error:
                self._interrupted(f"waiting: {error}")
                await asyncio.sleep(LOOK_S)
                continue
            return done

    async def _create(self) -> str:
        body = self._script.mission.model_dump(mode="json", exclude_none=True)
        return str((await self._ask("POST", "/missions", body))["id"])

    async def _fly(self, mission: str) -> None:
        """Look at the mission and act in time, until its end."""
        now = asyncio.get_running_loop().time
        while True:
            info = await self._ask("GET", f"/missions/{mission}")
            self._back()
            time_s = (info["time_s"] or 0.0) + self._paused.seconds(now())
            due = bool(self._actions) and self._actions[0].at_s <= time_s
            if info["state"] == "ended" or (time_s >= self._until_s and not due):
                return
            await self._keep_going(mission, info["state"])
            if due and await self._heard(mission, self._actions[0]):
                await self._act(mission, self._actions[0])
                self._late(time_s, self._actions.popleft())
                continue
            if info["state"] == "running" and not due:
                self._broken = False
                self._told.clear()
            await asyncio.sleep(LOOK_S)

    async def _keep_going(self, mission: str, state: str) -> None:
        """Start the mission; set it going again where it was broken off."""
        if state == "created":
            await self._ask("POST", f"/missions/{mission}/start")
            self._tell(f"mission {mission} flies")
        elif state == "failed":
            self._interrupted(f"mission {mission} has failed; it is started again")
            await self._ask("POST", f"/missions/{mission}/start")
        elif state == "held" and not self._holding:
            self._interrupted(f"mission {mission} came back held; it is resumed")
            await self._ask("POST", f"/missions/{mission}/resume")

    def _late(self, time_s: float, action: Say | Do) -> None:
        """Leave what was done late the time that it was to have until the end."""
        self._until_s = max(self._until_s, time_s + self._script.until_s - action.at_s)

    async def _heard(self, mission: str, action: Say | Do) -> bool:
        """Tell whether an action makes sense now: nobody talks of robots that are lost."""
        if isinstance(action, Do):
            return True
        snapshot = await self._ask("GET", f"/missions/{mission}/snapshot")
        lost = [robot["id"] for robot in snapshot["robots"] if robot["link"] == "lost"]
        if lost:
            self._interrupted(f"robots {', '.join(map(str, lost))} are lost; waiting for them")
        return not lost and (self._holding or snapshot["state"] == "running")

    async def _act(self, mission: str, action: Say | Do) -> None:
        if isinstance(action, Do):
            await self._ask("POST", f"/missions/{mission}/{action.do}")
            self._holding = action.do != "resume"
            now_s = asyncio.get_running_loop().time()
            if action.do == "pause":
                self._paused.begin(now_s)
            elif action.do == "resume":
                self._paused.end(now_s)
            self._tell(f"{action.at_s:g} s: {action.do}")
            return
        for comment in await self._ask("GET", f"/missions/{mission}/comments"):
            if comment["text"] == action.say and comment["id"] not in self._said:
                self._said[comment["id"]] = action  # its answer was lost on the way
                return
        answer = await self._ask("POST", f"/missions/{mission}/comments", {"text": action.say})
        self._said[answer["id"]] = action
        self._tell(f"{action.at_s:g} s: said {action.say!r}")

    async def _judge(self, mission: str) -> None:
        """Stop the mission and compare what it came to with what was expected."""
        await self._ask("POST", f"/missions/{mission}/stop")
        result = await self._ask("GET", f"/missions/{mission}/result")
        receipts = {c["id"]: c for c in await self._ask("GET", f"/missions/{mission}/comments")}
        self._verdict.checks = [
            *(_receipt_check(said, receipts.get(cid)) for cid, said in self._said.items()),
            *(_bound_check(name, bound, result) for name, bound in self._script.expect.items()),
            *(
                Check(f"at {action.at_s:g} s", "done", "the mission ended before", passed=False)
                for action in self._actions
            ),
        ]
        self._verdict.result = result

    async def _ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
        answer = await self._client.request(method, API + path, json=body)
        later = answer.status_code == HTTPStatus.TOO_MANY_REQUESTS
        if later or answer.status_code >= HTTPStatus.INTERNAL_SERVER_ERROR:
            raise _ServerAway(_words(answer))
        if answer.status_code == HTTPStatus.CONFLICT and _code(answer) in _PASSING:
            raise _NotYet(_words(answer))
        if answer.is_error:
            raise ScriptFailed(f"{method} {path}: {_words(answer)}")
        return answer.json() if answer.content else None

    def _interrupted(self, words: str) -> None:
        """Count an interruption once, however many signs of it there are."""
        self._verdict.interruptions += not self._broken
        if words not in self._told:
            self._tell(words)
        self._broken = True
        self._told.add(words)

    def _back(self) -> None:
        if self._away:
            self._away = False
            self._tell("the server is back")


@dataclass(slots=True)
class _Pauses:
    """How long the script has kept its mission paused, by a clock that goes on meanwhile."""

    over_s: float = 0.0
    """Sum of the pauses that are over."""

    since_s: float | None = None

    def begin(self, now_s: float) -> None:
        """Note that mission time stands still from now on, if it does not yet."""
        self.since_s = now_s if self.since_s is None else self.since_s

    def end(self, now_s: float) -> None:
        """Note that mission time goes on."""
        self.over_s, self.since_s = self.seconds(now_s), None

    def seconds(self, now_s: float) -> float:
        """Return how long it has been paused until now."""
        return self.over_s + (0.0 if self.since_s is None else now_s - self.since_s)


class _ServerAway(Exception):
    """Raised when the server cannot do it now and may be able to soon."""


class _NotYet(Exception):
    """Raised when the server is there and the mission is still being brought up."""


_PASSING: Final = frozenset({"wrong_state", "start_failed"})
"""Refusals that go away by themselves: the mission is being brought up."""


def _receipt_check(said: Say, receipt: dict[str, Any] | None) -> Check:
    status = None if receipt is None else receipt["status"]
    good = status is not None and (not said.expect or status in said.expect)
    return Check(
        f"comment at {said.at_s:g} s", " or ".join(said.expect) or "a receipt", status, passed=good
    )


def _bound_check(name: str, bound: Bound, result: dict[str, Any]) -> Check:
    found: Any = result
    for part in name.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    number = isinstance(found, int | float)
    good = number and bound.at_least <= found <= bound.at_most
    return Check(name, f"{bound.at_least:g} to {bound.at_most:g}", found, passed=bool(good))


def _words(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["error"]["message"])
    except (ValueError, KeyError, TypeError):
        return f"HTTP {answer.status_code}"


def _code(answer: httpx.Response) -> str:
    try:
        return str(answer.json()["error"]["code"])
    except (ValueError, KeyError, TypeError):
        return ""
