"""The panels of the library, drawn without a browser."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from console.panels.experiments import experiments, tables
from console.panels.library import missions, recordings
from console.panels.whatif import stories
from console.workshop import Change, WhatIf
from server.api.laboratory import Experiment, Progress
from server.api.models import Clock, MissionInfo
from server.encoding import MissionState
from server.mission.setup import GateMode

EVIL = '<script>alert("x")</script>'


def mission(number: int, **changes: Any) -> MissionInfo:
    known = {
        "id": f"m{number}", "scenario": "demo", "state": MissionState.ENDED,
        "clock": Clock.REALTIME, "llm": "mock", "gate": GateMode.OFF, "seed": 0,
        "created_at": datetime.now(UTC), "started_at": None, "time_s": 83.4, "reason": "",
    }  # fmt: skip
    return MissionInfo.model_validate(known | changes)


def recording(**changes: Any) -> dict[str, Any]:
    return {
        "name": "demo-1.mcap", "size_bytes": 2_500_000, "error": None, "duration_s": 605.0,
        "complete": True, "scenario": "demo", "llm": "mock",
        "started_at": "2030-01-01T12:00:00+00:00",
    } | changes  # fmt: skip


def story(**changes: Any) -> WhatIf:
    made = WhatIf(1, Change("m1", 60.0, "mock", GateMode.AUTO, "Track more boldly."), "ada")
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def test_missions_are_listed_newest_first_and_the_shown_one_is_marked() -> None:
    html = missions([mission(1), mission(2, clock=Clock.REPLAY)], "m2")
    assert html.index("<b>m2</b>") < html.index("<b>m1</b>")
    assert 'data-tap="mission:m1"' in html
    assert 'data-tap="mission:m2"' not in html
    assert "replay" in html
    assert "1:23" in html


def test_recordings_can_be_opened_and_broken_ones_say_why() -> None:
    html = recordings([recording(), recording(name="bad.mcap", error="cut off", duration_s=None)])
    assert html.count("data-tap=") == 1
    assert 'data-tap="recording:demo-1.mcap"' in html
    assert "10:05" in html
    assert "2.5 MB" in html
    assert "cut off" in html
    assert "being written" in recordings([recording(complete=False)])
    assert "FALCONER_RECORDINGS" in recordings([])
    assert "Looking" in recordings(None)


def test_a_fork_shows_both_stories() -> None:
    outcome = {
        "at_s": 60.0, "until_s": 120.0,
        "recorded": {"accumulated_trace": 10.0, "sensing_attacks": 3, "communication_attacks": 1},
        "forked": {"accumulated_trace": 8.0, "sensing_attacks": 5, "communication_attacks": 1},
    }  # fmt: skip
    html = stories([story(story=outcome)])
    assert '<td class="num">10</td><td class="num better">8</td>' in html
    assert '<td class="num">3</td><td class="num worse">5</td>' in html
    assert '<td class="num">1</td><td class="num">1</td>' in html
    assert "1:00 to 2:00" in html
    assert "Being flown" in stories([story()])
    assert "no longer" in stories([story(error="It is no longer there.")])


def test_an_experiment_shows_progress_and_what_it_found(tmp_path: Path) -> None:
    made = Experiment("e1", "ablation", (), 10, "ada", tmp_path, state=Progress.RUNNING, done=4)
    html = experiments([made])
    assert '<progress max="10" value="4"' in html
    assert 'data-tap="experiment:stop:e1"' in html
    made.state = Progress.DONE
    made.result = {
        "tables": {"means": [{"row": EVIL, "trace": 87.31, "trace_half_width": 0.84}]},
    }
    assert 'data-tap="experiment:show:e1"' in experiments([made])
    assert "87.31 ± 0.84" in tables(made)
    assert "<script>" not in tables(made)


def test_what_comes_from_outside_is_never_run(tmp_path: Path) -> None:
    failed = Experiment("e1", EVIL, (), 1, EVIL, tmp_path, state=Progress.FAILED, error=EVIL)
    said = Change(EVIL, 1.0, EVIL, None, EVIL)
    for html in (
        missions([mission(1, scenario=EVIL)], ""),
        recordings([recording(scenario=EVIL, llm=EVIL, name=EVIL), recording(error=EVIL)]),
        stories([WhatIf(1, said, EVIL, error=EVIL)]),
        experiments([failed]),
    ):
        assert "<script>" not in html
        assert "&lt;script&gt;" in html
