"""What texts that try to take over a model do to a mission's directives.

    python -m benchmarks.injections

Each text of the corpus is said as a comment, and used as the name of a zone, to both models, in
both forms of the answer, with the mock sound and with the mock told to obey. Counted are the
answers that were accepted and would change something in force (within its bounds), and those
that would leave the bounds: none may.
"""

import argparse
import asyncio
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

from rich.console import Console
from rich.progress import track

from llm.consultation import Accepted, changes
from llm.mock.behaviours import Behaviour, Mode
from llm.prompts import AnswerForm, Loop, PromptView
from solver.snapshot import Snapshot
from tests.llm.builders import LIMITS, Scene, zone
from tests.llm.injections import CORPUS
from tests.llm.mock.asking import consulted
from tests.llm.test_injections import jammed, outside

CHANNELS = ("comment", "zone name")


@dataclass(frozen=True, slots=True)
class Attempt:
    """One text, said in one way."""

    channel: str
    mode: Mode
    loop: Loop
    form: AnswerForm
    text: str

    def snapshot(self) -> Snapshot:
        """Return the team that hears it."""
        return self.scene().snapshot()

    def scene(self) -> Scene:
        """Return the scene with the text in its place."""
        if self.channel == "comment":
            return jammed().saying(self.text)
        area = zone(self.text, mean=(2.0, 1.5))
        return replace(jammed(), zones=(area,), severities={})


def attempts() -> Iterator[Attempt]:
    """Yield every text in every way."""
    for channel in CHANNELS:
        for mode in (Mode.SOUND, Mode.OBEY):
            for loop in Loop:
                for form in AnswerForm:
                    for text in CORPUS:
                        yield Attempt(channel, mode, loop, form, text)


async def tried(attempt: Attempt) -> str:
    """Return what an attempt came to: outside, changed, unchanged or refused."""
    snapshot = attempt.snapshot()
    view = PromptView(snapshot, LIMITS, form=attempt.form)
    _, outcome = await consulted(view, attempt.loop, Behaviour(attempt.mode))
    if not isinstance(outcome, Accepted):
        return "refused"
    if outside(outcome.proposal, snapshot):
        return "outside"
    return "changed" if changes(outcome.proposal, snapshot) else "unchanged"


async def campaign() -> dict[tuple[str, Mode], Counter[str]]:
    """Return the counts per channel and mode of the mock, and the texts that changed something."""
    counts: dict[tuple[str, Mode], Counter[str]] = {}
    everything = list(attempts())
    for attempt in track(everything, console=Console(stderr=True)):
        counter = counts.setdefault((attempt.channel, attempt.mode), Counter())
        result = await tried(attempt)
        counter[result] += 1
        if result in ("changed", "outside"):
            counter[f"{result}: {attempt.text[:70]!r}"] += 1
    return counts


def main() -> None:
    """Run the campaign and print the counts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--list", action="store_true", help="Also the texts that changed anything.")
    arguments = parser.parse_args()
    counts = asyncio.run(campaign())
    print(f"{len(CORPUS)} texts, to 2 models, in 2 forms of the answer each")
    for (channel, mode), counter in counts.items():
        told = ", ".join(
            f"{counter[kind]} {kind}" for kind in ("unchanged", "refused", "changed", "outside")
        )
        texts = sorted(key for key in counter if ":" in key)
        print(f"as a {channel}, mock {mode.value}: {told}; by {len(texts)} of the texts")
        for text in texts if arguments.list else ():
            print(f"    {counter[text]} x {text}")


if __name__ == "__main__":
    main()
