"""Every code block of README and docs/ is run: in order, page by page, in a scratch folder.

`rules` says how each command is run, and lists the few that other tests run. Pages are run side by
side, two at a time where no other tests run.
"""

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from tests.docs.blocks import Block, blocks
from tests.docs.rules import Way, rule_of, statements_of
from tests.docs.sessions import BlockError, Memory, Session

ROOT = Path(__file__).resolve().parents[2]
BLOCKS = blocks(ROOT)
SHELL = [block for block in BLOCKS if block.language == "sh"]
SIDE_BY_SIDE = 1 if "PYTEST_XDIST_WORKER" in os.environ else 2
SCRIPT = """
name: short
mission: {scenario: demo, llm: mock}
until_s: 2.0
actions:
  - {at_s: 0.5, say: The robots should be more aggressive.}
expect:
  optimizer.success_rate: {at_least: 0.9}
"""

pytestmark = [pytest.mark.process, pytest.mark.timeout(1800)]


class Pages:
    """Runs the pages in the background; a test takes its block's outcome."""

    def __init__(self, folder: Path, wanted: list[Block]) -> None:
        self._folder = folder
        self._memory = Memory()
        self._outcomes: dict[Block, Future[None]] = {block: Future() for block in SHELL}
        self._pool = ThreadPoolExecutor(SIDE_BY_SIDE)
        self._closed = [
            self._pool.submit(self._page, page)
            for page in dict.fromkeys(block.page for block in wanted)
        ]

    def outcome(self, block: Block) -> None:
        """Wait for a block. Raises what it raised."""
        self._outcomes[block].result()

    def close(self) -> None:
        """Wait for everything that was begun, and end it."""
        self._pool.shutdown(cancel_futures=True)
        for page in self._closed:
            if not page.cancelled():
                page.result()

    def _page(self, page: str) -> None:
        folder = self._folder / re.sub(r"\W", "-", page)
        folder.mkdir()
        self._supply(page, folder)
        session = Session(folder, self._memory)
        own = [block for block in SHELL if block.page == page]
        try:
            for block in own:
                try:
                    session.run(block)
                except (BlockError, OSError, ValueError, subprocess.SubprocessError) as error:
                    self._outcomes[block].set_exception(error)
                else:
                    self._outcomes[block].set_result(None)
        finally:
            for block in own:
                if not self._outcomes[block].done():
                    self._outcomes[block].set_exception(BlockError("was not reached"))
            session.close()

    def _supply(self, page: str, folder: Path) -> None:
        """Put the files there that the page speaks of and does not make."""
        text = (ROOT / page).read_text("utf-8")
        own = [block.text for block in BLOCKS if block.page == page and block.language == "yaml"]
        reference = "docs/reference/scenarios.md"
        first = next(block.text for block in BLOCKS if block.page == reference)
        (folder / "my-scenario.yaml").write_text(first, "utf-8")
        (folder / "my-script.yaml").write_text(SCRIPT, "utf-8")
        if "`patrol.yaml`" in text:
            (folder / "patrol.yaml").write_text(own[0], "utf-8")


@pytest.fixture(scope="module")
def pages(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Pages]:
    """Run the pages of the tests that were chosen."""
    chosen = (getattr(item, "callspec", None) for item in request.session.items)
    params = [each.params.get("block") for each in chosen if each]
    # Other tests of the session may have parameters of this name, and mean something else.
    wanted = [each for each in params if isinstance(each, Block)]
    folder = tmp_path_factory.mktemp("pages")
    running = Pages(folder, [block for block in wanted if block.language == "sh"])
    yield running
    running.close()


@pytest.mark.parametrize("block", SHELL, ids=lambda block: block.name)
def test_commands_do_what_they_should(block: Block, pages: Pages) -> None:
    pages.outcome(block)


def test_programs_understand_their_documented_options() -> None:
    """Those that are too long to be run here, by their own parsers (argparse)."""
    lines = [
        statement.split()[2:]
        for block in SHELL
        for statement in statements_of(block)
        if re.match(r"python -m (benchmarks|tests\.vehicles)\.", statement)
        and rule_of(statement).way is Way.ELSEWHERE
    ]
    assert len(lines) > 10
    code = """
import argparse, json, runpy, sys
understood = argparse.ArgumentParser.parse_args
def stop(parser, *given):
    understood(parser, *given)
    raise KeyboardInterrupt
argparse.ArgumentParser.parse_args = stop
for line in json.loads(sys.argv[1]):
    sys.argv = line
    try:
        runpy.run_module(line[0], run_name="__main__")
    except KeyboardInterrupt:
        continue
    except SystemExit as end:
        sys.exit(f"{line}: {end}")
    sys.exit(f"{line}: has no parser")
"""
    command = [sys.executable, "-W", "ignore", "-c", code, json.dumps(lines)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
