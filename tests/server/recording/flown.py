"""Recorded lockstep flights, for tests to look at."""

import asyncio
from dataclasses import replace
from pathlib import Path
from typing import Any

from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY, ScriptedComment
from server.recording.session import recorded_run
from server.scenarios import library
from server.settings import load_settings

FOCUS = "The drone 0 should focus on tracking target 1"


def fly(
    path: Path,
    llm: str = "mock",
    steps: int = 90,
    comments: tuple[ScriptedComment, ...] = (),
    seed: int = 3,
) -> dict[str, Any]:
    """Fly the ablation scenario into a recording; return the result."""
    scenario = library.named("ablation")
    setup = replace(scenario.mission_setup("sqp"), steps=steps, seed=seed)
    assembly = Assembly(
        setup=setup,
        world=scenario.world_setup(),
        llm=llm,
        latency=PAPER_LATENCY,
        settings=load_settings(),
    )
    failures: list[str] = []
    with recorded_run(path, assembly, failures.append) as (writer, chronicle):
        result = asyncio.run(
            assembly.run(
                comments,
                lambda done: None,
                writer,
                witness=chronicle.note,
                listener=chronicle.decide,
            )
        )
        chronicle.close(result)
    assert not failures
    return result
