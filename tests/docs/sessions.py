"""Runs the shell blocks of one page, in order, as a reader at a terminal would.

A page has a scratch folder with the product on its path and the files that pages speak of, and
ports of its own in the place of the usual ones. What goes on until it is ended is waited for until
it is up, and ended by Ctrl-C after its block.
"""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.fleet import free_port
from tests.docs.blocks import Block
from tests.docs.rules import (
    KEPT,
    NEEDED,
    REFUSED,
    Way,
    matches,
    rule_of,
    shortened,
    statements_of,
)
from tests.patience import busy

PROGRAMS = Path(sys.executable).parent
PORT = re.compile(r"\b(?:8000|8001|8081|7447|145[0-9]{2})\b")
FOREIGN = re.compile(r"\b(?:0\.0\.0\.0|192\.0\.2\.\d+)\b")
TOKEN = "a-token-for-the-documentation"
UP = "Ctrl-C ends it"
LIMIT_S = 120.0
"""For each statement on an idle machine; more on a busy one."""


class BlockError(AssertionError):
    """Raised when a statement of the documentation does not do what it should."""


@dataclass
class Running:
    """Something that goes on until it is ended."""

    statement: str
    process: subprocess.Popen[str]
    log: Path

    def wait_until_up(self) -> None:
        """Return when it says that it is up. Raises BlockError."""
        flies = re.match(r"falconer (run|serve) [a-z]", self.statement)
        sign = "mission started" if flies else UP
        until = time.monotonic() + LIMIT_S * busy()
        while True:
            over = self.process.poll() is not None or time.monotonic() > until
            said = self.log.read_text("utf-8", "replace")  # afterwards: all that it has said
            if sign in said:
                return
            if over:
                self.process.kill()
                raise BlockError(f"{self.statement} did not come up:\n{said}")
            time.sleep(0.05)

    def end(self) -> None:
        """Press Ctrl-C. Raises BlockError where it does not end well."""
        self.process.send_signal(signal.SIGINT)
        try:
            code = self.process.wait(LIMIT_S * busy())
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise BlockError(f"{self.statement} does not end") from None
        said = self.log.read_text("utf-8", "replace")
        if code not in (0, 130) or "Traceback" in said:
            raise BlockError(f"{self.statement} ended with {code}:\n{said}")


@dataclass
class Memory:
    """What all pages share: a command without files is run once, and no port is given twice."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    done: set[str] = field(default_factory=set)
    ports: set[int] = field(default_factory=set)
    """Those that were given away: pages run side by side, and use theirs later."""

    def free_port(self, kind: socket.SocketKind) -> int:
        """Return a port that nobody uses, another one each time."""
        with self.lock:
            taken = len(self.ports)
            while len(self.ports) == taken:
                port = free_port(kind)
                self.ports.add(port)
            return port

    def remembers(self, statement: str) -> bool:
        """Tell whether a statement that leaves nothing behind has been run; note that it is."""
        if re.search(r"\.(yaml|mcap)\b|--(out|port|llm)\b|http", statement):
            return False
        with self.lock:
            known = statement in self.done
            self.done.add(statement)
            return known


@dataclass
class Session:
    """The terminal of one page."""

    folder: Path
    memory: Memory
    ports: dict[str, str] = field(default_factory=dict)
    running: list[Running] = field(default_factory=list)
    said_before: list[str] = field(default_factory=list)
    """Variables and aliases of the page's shell."""

    def run(self, block: Block) -> None:
        """Run one block. Raises BlockError."""
        try:
            for statement in statements_of(block):
                self._statement(shortened(statement))
        finally:
            self._end([each for each in self.running if each.statement not in KEPT])

    def close(self) -> None:
        """End what was kept."""
        self._end(list(self.running))

    # ------------------------------------------------------------------ statements

    def _statement(self, statement: str) -> None:
        way = rule_of(statement).way
        if way is Way.SHELL:
            self.said_before.append(statement)
        elif way is Way.SYSTEM:
            subprocess.run(["bash", "-n", "-c", statement], check=True, timeout=LIMIT_S)
        elif way is Way.REQUEST:
            self._request(statement)
        elif way is Way.LIVE:
            self._need(statement)
            self._start(statement)
        elif way is Way.DONE and not self.memory.remembers(statement):
            self._need(statement)
            self._finish(statement)

    def _need(self, statement: str) -> None:
        for pattern, command in NEEDED.items():
            up = any(each.statement == command for each in self.running)
            if matches(pattern, statement) and not up:
                self._start(command)

    def _start(self, statement: str) -> None:
        wanted = _ports_of(statement)
        self._end([each for each in self.running if wanted & _ports_of(each.statement)])
        log = self.folder / f"log-{len(list(self.folder.glob('log-*')))}"
        with log.open("w", encoding="utf-8") as output:
            process = subprocess.Popen(
                self._shell(f"exec {statement}"),
                cwd=self.folder,
                env=self._environment(statement),
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                text=True,
            )
        running = Running(statement, process, log)
        self.running.append(running)
        running.wait_until_up()

    def _finish(self, statement: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            self._shell(statement),
            cwd=self.folder,
            env=self._environment(statement),
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=LIMIT_S * busy(),
            check=False,
        )
        if done.returncode != 0 or "Traceback" in done.stderr:
            raise BlockError(
                f"{statement} ended with {done.returncode}:\n{done.stdout}{done.stderr}"
            )
        if " --json" in statement and statement.startswith("falconer"):
            json.loads(done.stdout)
        return done

    def _request(self, statement: str) -> None:
        answer = json.loads(self._finish(statement).stdout)
        refusal = answer.get("error", {}).get("code") if isinstance(answer, dict) else None
        allowed = [code for pattern, code in REFUSED.items() if matches(pattern, statement)]
        if refusal is not None and refusal not in allowed:
            raise BlockError(f"{statement} was refused: {answer}")

    def _end(self, those: list[Running]) -> None:
        self.running = [each for each in self.running if each not in those]
        wrong = []
        for each in reversed(those):
            try:
                each.end()
            except BlockError as error:
                wrong.append(str(error))
        if wrong:
            raise BlockError("\n".join(wrong))

    # ------------------------------------------------------------------ surroundings

    def _shell(self, statement: str) -> list[str]:
        script = "\n".join([*self.said_before, statement])
        local = FOREIGN.sub("127.0.0.1", PORT.sub(lambda usual: self._port(usual[0]), script))
        return ["bash", "-O", "expand_aliases", "-c", local]

    def _port(self, usual: str) -> str:
        if usual not in self.ports:
            kind = socket.SOCK_DGRAM if usual.startswith("145") else socket.SOCK_STREAM
            self.ports[usual] = str(self.memory.free_port(kind))
        return self.ports[usual]

    def _environment(self, statement: str) -> dict[str, str]:
        kept = {name: value for name, value in os.environ.items() if "FALCONER" not in name}
        own = {
            "PATH": f"{PROGRAMS}:{os.environ['PATH']}",
            "XDG_STATE_HOME": str(self.folder / "state"),
            "FALCONER_PORT": self._port("8000"),
            "FALCONER_ADMIN_TOKEN": TOKEN,
        }
        if statement.startswith("falconer vehicle"):
            own["FALCONER_ZENOH_CONNECT"] = f"tcp/127.0.0.1:{self._port('7447')}"
        return kept | own


def _ports_of(statement: str) -> set[str]:
    """Return the usual ports that a live command listens on."""
    listens = set(re.findall(r"--(?:port|listen|zenoh-listen) (?:tcp/\S+:)?(\d+)", statement))
    if re.match(r"falconer (run|serve|replay)\b", statement) and "--port" not in statement:
        listens.add("8000")
    return listens
