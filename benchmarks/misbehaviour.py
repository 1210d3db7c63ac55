"""One live mission whose language model misbehaves in every way in turn.

    python -m benchmarks.misbehaviour --seconds 35 --scenario hardware

Each way for the same time over real HTTP, with a sound model at first, half way and at the end.
For each: calls and refused tries, whether anything in force ever left its bounds, and how
punctual the ticks were beside those with the sound model. At the end every refused try is looked
for among the events in the journal.
"""

import argparse
import asyncio
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console
from rich.progress import track

from benchmarks.live import MISSION, MockServer, Ticks, Watch, live_mission, outside, served_mock
from llm.mock.behaviours import Mode
from server.api.service import MissionService
from server.mission.setup import GateMode, MissionSetup
from server.scenarios import library
from server.settings import Settings
from vehicles.world.setup import WorldSetup

WAYS = (
    Mode.SOUND,
    Mode.FAIL_429,
    Mode.GARBAGE,
    Mode.FAIL_500,
    Mode.EMPTY,
    Mode.STALL,
    Mode.REFUSE,
    Mode.NOT_JSON,
    Mode.HUGE,
    Mode.SOUND,
    Mode.OVER_CAPACITY,
    Mode.UNCOVERED,
    Mode.UNKNOWN_IDS,
    Mode.NAN,
    Mode.WRONG_LENGTH,
    Mode.OUT_OF_BOUNDS,
    Mode.SLOW,
    Mode.OBEY,
    Mode.SOUND,
)
HARMLESS = frozenset({Mode.SOUND, Mode.SLOW, Mode.OBEY})
"""Ways in which an answer may be valid all the same."""

SILENCING = frozenset({Mode.FAIL_429, Mode.FAIL_500, Mode.SLOW, Mode.STALL})
"""Ways after which the endpoint is left alone for a while: the next one waits for that."""

FAULTS = frozenset({"no_answer", "parsing", "verification"})
"""By whom a decision was refused where the model is to blame."""

ORDER = "[0, 0, 0, 0]"
"""What an obedient model repeats as its answer."""

EVENTS_READ = 1000
LONGEST_S = 3600.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """One way of behaving, for some time."""

    mode: Mode
    ticks: Ticks
    calls: dict[str, int]
    refused: int
    """Tries that came to nothing, told in events."""

    reasons: tuple[str, ...]
    """Some of their reasons."""


@dataclass(frozen=True, slots=True)
class Trial:
    """A whole run."""

    stretches: tuple[Stretch, ...]
    outside: tuple[str, ...]
    """Directives that left their bounds: none, it is hoped."""

    refused: int
    """Tries that were refused, by the loops' own count."""

    journalled: int
    """Refusals among the events in the journal."""

    unexplained: int
    """Refusals without a reason."""

    def missed_share(self, *, sound: bool) -> float:
        """Return which part of the ticks was missed with a sound model, or with any other."""
        each = [s.ticks for s in self.stretches if (s.mode is Mode.SOUND) is sound]
        return sum(t.missed for t in each) / max(1, sum(t.ticks for t in each))


Enough = Callable[[Watch, Mode, int, float], bool]


def for_seconds(seconds: float) -> Enough:
    """Return a judge who lets every stretch last so long."""
    return lambda watch, mode, first, began_s: time.monotonic() - began_s >= seconds


def refusals(events: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the events that tell of one refused try each."""
    found = []
    for event in events:
        data = event["data"]
        if event["kind"] == "verdict" and "try" in data:
            found.append({"loop": data["loop"], "text": event["text"]})
        card = data.get("decision", {}) if event["kind"] == "decision" else {}
        if card.get("refused_by") in FAULTS:
            found.append({"loop": card["loop"], "text": "; ".join(card["reasons"])})
    return found


async def provoke(
    setup: MissionSetup,
    world: WorldSetup,
    settings: Settings,
    enough: Enough,
    delay_s: float,
    ways: tuple[Mode, ...] = WAYS,
    progress: Callable[[tuple[Mode, ...]], Any] = iter,
) -> Trial:
    """Fly once, with every way of misbehaving in turn and quiet stretches between."""
    watch = Watch()
    with served_mock() as mock:
        async with live_mission(setup, world, mock.url, watch, settings) as service:
            await service.comment(MISSION, ORDER, "benchmark")
            stretches = []
            for mode in progress(ways):
                stretches.append(await _stretch(watch, mock, mode, enough, delay_s))
                if mode in SILENCING:
                    await _mended(watch, mock)
            mock.behave(Mode.SOUND, 0.0)
            await service.stop(MISSION, "benchmark")
            result = await service.result(MISSION)
            journal = await _journalled(service)
    loops = (result["task_llm"], result["action_llm"])
    told = refusals(journal)
    return Trial(
        stretches=tuple(stretches),
        outside=tuple(word for said in watch.snapshots for word in outside(said)),
        refused=sum(loop["tries"] - loop["valid"] for loop in loops),
        journalled=len(told),
        unexplained=sum(not each["text"].strip() for each in told),
    )


async def _stretch(
    watch: Watch, mock: MockServer, mode: Mode, enough: Enough, delay_s: float
) -> Stretch:
    await asyncio.to_thread(mock.behave, mode, delay_s)
    began_s, first, before = time.monotonic(), len(watch.told), watch.calls()
    await watch.until(lambda: enough(watch, mode, first, began_s), LONGEST_S)
    events = [said for _, said in watch.told[first:] if said["type"] == "event"]
    told = refusals(events)
    return Stretch(
        mode=mode,
        ticks=watch.ticks(began_s, time.monotonic()),
        calls={loop: count - before.get(loop, 0) for loop, count in watch.calls().items()},
        refused=len(told),
        reasons=tuple(dict.fromkeys(each["text"] for each in told)),
    )


async def _mended(watch: Watch, mock: MockServer) -> None:
    """Wait until both loops have had a sound answer again."""
    await asyncio.to_thread(mock.behave, Mode.SOUND, 0.0)
    first = len(watch.told)

    def sound() -> bool:
        events = [said for _, said in watch.told[first:] if said["type"] == "event"]
        cards = [event["data"].get("decision", {}) for event in events]
        loops = {card.get("loop") for card in cards if card.get("refused_by") not in FAULTS}
        return {"task", "action"} <= loops

    await watch.until(sound, LONGEST_S)


async def _journalled(service: MissionService) -> list[dict[str, Any]]:
    events: list[dict[str, Any]] = []
    while page := await service.events(MISSION, events[-1]["seq"] if events else 0, EVENTS_READ):
        events += page
    return events


def hasty(setup: MissionSetup, period_s: float) -> MissionSetup:
    """Return a setup whose models are asked as often as their rest allows."""
    loops = replace(setup.loops, task_period_s=period_s, action_period_s=period_s)
    return replace(setup, loops=loops, steps=1_000_000, gate=GateMode.AUTO)


def main() -> None:
    """Run it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--scenario", default="hardware")
    parser.add_argument("--seconds", type=float, default=35.0, help="Of each way.")
    parser.add_argument("--delay", type=float, default=60.0, help="Of slow and stalled replies.")
    arguments = parser.parse_args()
    chosen = library.load(arguments.scenario)
    settings = Settings()
    trial = asyncio.run(
        provoke(
            hasty(chosen.mission_setup(settings.engine), 1.0),
            chosen.world_setup(),
            settings,
            for_seconds(arguments.seconds),
            arguments.delay,
            progress=lambda ways: track(ways, console=Console(stderr=True)),
        )
    )
    _print(trial)


def _print(trial: Trial) -> None:
    form = "{:14} {:>9} {:>8} {:>6} {:>7} {:>9} {:>9} {:>9}  {}"
    heads = ("way", "calls", "refused", "ticks", "missed", "p50 ms", "p99 ms", "max ms", "reason")
    print(form.format(*heads))
    for stretch in trial.stretches:
        ticks = stretch.ticks
        print(
            form.format(
                stretch.mode.value,
                "+".join(str(count) for count in stretch.calls.values()),
                stretch.refused,
                ticks.ticks,
                ticks.missed,
                *(f"{ms:.1f}" for ms in (ticks.late_p50_ms, ticks.late_p99_ms, ticks.late_max_ms)),
                stretch.reasons[0][:70] if stretch.reasons else "",
            )
        )
    print(
        f"missed: {trial.missed_share(sound=True):.4%} with the sound model, "
        f"{trial.missed_share(sound=False):.4%} otherwise\n"
        f"directives outside their bounds: {len(trial.outside)}\n"
        f"refused tries: {trial.refused}, in the journal {trial.journalled}, "
        f"without a reason {trial.unexplained}"
    )


if __name__ == "__main__":
    main()
