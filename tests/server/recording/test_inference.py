"""A flight whose zones nothing reveals, recorded and flown again."""

import asyncio
from pathlib import Path

from server.lockstep.assembly import Assembly
from server.lockstep.job import PAPER_LATENCY
from server.recording.reader import open_recording
from server.recording.session import recorded_run
from server.recording.verification import verify_recording
from server.scenarios import library
from server.scenarios.schema import Scenario
from server.settings import load_settings
from solver.snapshot import Snapshot
from vehicles.world.world import World

STEPS = 50


def test_inferred_zones_are_found_again_bit_for_bit(tmp_path: Path) -> None:
    named = library.named("unseen").model_dump()
    first, *others = named["zones"]
    zones = [first | {"mean": (-5.6, 2.2)}, *others]  # on the first robot's way
    planner = named["planner"] | {"horizon": 1}
    changed = {"zones": zones, "planner": planner, "steps": STEPS}
    scenario = Scenario.model_validate(named | changed)
    setup = scenario.mission_setup("sqp")
    assembly = Assembly(setup, scenario.world_setup(), "none", PAPER_LATENCY, load_settings())
    known: list[tuple[str, float]] = []
    hits = 0

    path = tmp_path / "unseen.mcap"
    failures: list[str] = []
    with recorded_run(path, assembly, failures.append) as (writer, chronicle):

        def look(snapshot: Snapshot, world: World) -> None:
            nonlocal hits
            chronicle.note(snapshot, world)
            known[:] = [(one.zone_id, one.confidence) for one in snapshot.inferred]
            hits += len(snapshot.attacks)

        result = asyncio.run(
            assembly.run((), lambda _: None, writer, witness=look, listener=chronicle.decide)
        )
        chronicle.close(result)
    assert not failures
    assert hits > 0
    assert known, "some zone is believed in by now"
    assert all(0.0 < confidence <= 1.0 for _, confidence in known)
    recording = open_recording(path)
    assert recording.header.setup.hazards == setup.hazards
    found = verify_recording(recording, lambda _: None)
    assert (found.passed, found.ticks, found.differences) == (True, STEPS, [])
