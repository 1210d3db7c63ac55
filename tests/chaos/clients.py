"""Two programs and a browser that use the server all the while; the third program is the `Ear`."""

import asyncio
import json
import random
from contextlib import suppress
from dataclasses import dataclass, field
from http import HTTPStatus
from typing import Any

import httpx
from playwright.async_api import Error as BrowserError
from playwright.async_api import Page, async_playwright

from tests.chaos.journals import Database, asked
from tests.chaos.watch import Findings, Invariant
from tests.patience import PATIENCE_S

AGAIN_S = 0.2
COMMENT_S = 1.5
STEER_S = 1.0
PAGE_LIMIT = 1000
BROWSER = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
SENTENCES = (
    "The Drone 23 should focus on tracking target 104.",
    "Keep farther away from the sensing zones.",
    "Track more boldly.",
    "The robots should stay well clear of each other.",
)


@dataclass
class Commenter:
    """Says something again and again, and remembers what was acknowledged."""

    address: str
    headers: dict[str, str]
    findings: Findings
    dice: random.Random
    acknowledged: dict[str, str] = field(default_factory=dict)
    """Text by id, the first one where an id was given out again: that comment is lost."""

    refused: list[str] = field(default_factory=list)
    """Codes of the errors that came back instead."""

    async def run(self) -> None:
        """Comment for ever."""
        async with api(self.address, self.headers) as http:
            while True:
                with suppress(httpx.HTTPError):
                    await self._say(http)
                await asyncio.sleep(COMMENT_S)

    async def _say(self, http: httpx.AsyncClient) -> None:
        text = f"{self.dice.choice(SENTENCES)} Note {len(self.acknowledged)}."
        answer = await http.post("/missions/m1/comments", json={"text": text})
        if answer.status_code == HTTPStatus.CREATED:
            self.acknowledged.setdefault(answer.json()["id"], text)
        elif answer.headers.get("content-type", "").startswith("application/json"):
            self.refused.append(answer.json()["error"]["code"])

    async def compare(self) -> None:
        """Ask the server for every comment and look for what it has acknowledged."""
        wanted = dict(self.acknowledged)
        async with api(self.address, self.headers) as http:
            said = (await asked_of(http, f"/missions/m1/comments?limit={PAGE_LIMIT}")).json()
        known = {comment["id"]: comment["text"] for comment in said}
        self._missing(wanted, known, "the server")

    async def compare_journal(self, database: Database) -> None:
        """Look for what was acknowledged in the database itself."""
        wanted = dict(self.acknowledged)
        known = json.loads(await asked(database, "comments"))
        self._missing(wanted, known, "the journal")

    def _missing(self, wanted: dict[str, str], known: dict[str, str], where: str) -> None:
        self.findings.looked(Invariant.COMMENTS, len(wanted))
        for one, text in wanted.items():
            if known.get(one) != text:
                words = f"{where} does not know comment {one} ({text!r})"
                self.findings.broken(Invariant.COMMENTS, f"{where} {one}", words)


@dataclass
class Steerer:
    """Changes weights and pins, as often within bounds as outside of them."""

    address: str
    headers: dict[str, str]
    findings: Findings
    dice: random.Random
    answers: dict[int, int] = field(default_factory=dict)

    async def run(self) -> None:
        """Steer for ever."""
        async with api(self.address, self.headers) as http:
            while True:
                with suppress(httpx.HTTPError):
                    await self._steer(http)
                await asyncio.sleep(STEER_S)

    async def _steer(self, http: httpx.AsyncClient) -> None:
        mad = self.dice.random() < 0.5
        body: dict[str, Any]
        match self.dice.randrange(3):
            case 0:
                tracking = self.dice.choice((1e6, -1.0, 0.0)) if mad else self.dice.uniform(50, 200)
                body = {"tracking": tracking, "control": 0.01, "sensing": 50, "communication": 50}
                answer = await http.put("/missions/m1/weights", json=body)
            case 1:
                robot, target = (99, 101) if mad else (23, 103)
                body = {"robot": robot, "target": target, "ttl_s": 5.0}
                answer = await http.put("/missions/m1/pins/chaos", json=body)
            case _:
                most = 1_000_000 if mad else 2
                body = {"capacities": {"24": most}}
                answer = await http.put("/missions/m1/capacities", json=body)
        self.answers[answer.status_code] = self.answers.get(answer.status_code, 0) + 1
        if mad and answer.is_success:
            words = f"{answer.request.method} {answer.request.url.path} took {body}"
            self.findings.broken(Invariant.BOUNDS, words, words)


@dataclass
class Visitor:
    """A browser with the console open."""

    page: Page
    trouble: list[str]
    """What the page's own scripts complained of."""

    async def follows(self, patience_s: float) -> None:
        """Fail unless the page shows the mission's clock go on, and its scripts had no trouble."""
        clock = self.page.locator(".clock")
        loop = asyncio.get_running_loop()
        until_s, seen = loop.time() + patience_s, set[str]()
        while loop.time() < until_s and len(seen) < 2:
            with suppress(BrowserError):
                seen.add(await clock.inner_text(timeout=2000.0))
            await asyncio.sleep(0.5)
        assert len(seen) > 1, f"the browser's clock stands at {seen}"
        assert not self.trouble, f"the browser's scripts complain: {self.trouble}"


@dataclass
class Browser:
    """Owner of the browser: `async with`, gives a `Visitor`."""

    address: str
    token: str
    executable: str | None
    _close: list[Any] = field(default_factory=list)

    async def __aenter__(self) -> Visitor:
        playwright = await async_playwright().start()
        self._close.append(playwright.stop)
        browser = await playwright.chromium.launch(executable_path=self.executable, args=BROWSER)
        self._close.append(browser.close)
        page = await browser.new_page()
        page.set_default_timeout(60_000.0)
        trouble: list[str] = []
        page.on("pageerror", lambda error: trouble.append(str(error)))
        # Drawn by software the scene would take a processor of its own.
        await page.route(
            "**/scene/*/", lambda route: route.fulfill(body="", content_type="text/html")
        )
        await page.goto(self.address + "/login")
        await page.fill("input[name=token]", self.token)
        await page.press("input[name=token]", "Enter")
        await page.locator(".clock").wait_for()
        return Visitor(page, trouble)

    async def __aexit__(self, *exception: object) -> None:
        for close in reversed(self._close):
            with suppress(BrowserError):
                await close()


async def asked_of(http: httpx.AsyncClient, path: str) -> httpx.Response:
    """Ask until there is an answer: who has just started, or has much to do, gives it later.

    Raises TimeoutError.
    """
    async with asyncio.timeout(PATIENCE_S):
        while True:
            with suppress(httpx.HTTPError):
                return (await http.get(path)).raise_for_status()
            await asyncio.sleep(AGAIN_S)


def api(address: str, headers: dict[str, str]) -> httpx.AsyncClient:
    """Return a client of the server's API."""
    return httpx.AsyncClient(
        base_url=f"{address}/api/v1", headers=headers, timeout=10.0, trust_env=False
    )
