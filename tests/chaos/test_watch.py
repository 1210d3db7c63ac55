"""What the chaos suite judges, and what it does not take for a fault: no process, no clock."""

from time import monotonic
from typing import Any

import pytest

from server.scenarios import library
from tests.chaos.ear import COVERED_S, Ear
from tests.chaos.team import FILE
from tests.chaos.watch import PART_S, Findings, Invariant, Watch
from vehicles import messages as wire
from vehicles.inbox import Sample
from vehicles.keys import Topic

NEAR, FAR = (0.0, 0.5), (0.0, 5.0)


class Sky:
    """Robots 23 and 24 as the world and they themselves tell of them, by one clock."""

    def __init__(self) -> None:
        self.watch = Watch(library.load(str(FILE)), Findings(), ())
        self.now_s = monotonic()

    def pass_by(
        self, place: tuple[float, float], *, jammed: bool = False, seconds: float = 0.1
    ) -> None:
        """Let robot 24 be at a place, some of it jammed, while robot 23 hangs at the origin."""
        for _ in range(round(10.0 * seconds)):
            self.now_s += 0.1
            self.say(23, wire.Mode.FLYING, (0.0, 0.0))
            if not jammed:
                self.say(24, wire.Mode.FLYING, place)
            robots = tuple(
                wire.TrueRobotPart(
                    id=robot_id,
                    position=where,
                    velocity=(0.0, 0.0),
                    altitude_m=3.0,
                    sensing_failed=False,
                    jammed=jammed and robot_id == 24,
                )
                for robot_id, where in ((23, (0.0, 0.0)), (24, place))
            )
            truth = wire.Truth(
                **self._header(), time_s=0.0, step=0, state=wire.WorldState.RUNNING, robots=robots,
                targets=(), zones=(), hits=wire.HitsPart(sensing=0, communication=0),
            )  # fmt: skip
            self.watch._take(Sample(self.watch.keys.truth, wire.encode(truth)))

    def say(self, robot_id: int, mode: wire.Mode, place: tuple[float, float] = FAR) -> None:
        """Let a robot tell where it is."""
        state = wire.State(
            **self._header(), robot_id=robot_id, position=place, velocity=(0.0, 0.0),
            altitude_m=3.0, sensing_failed=False, mode=mode,
        )  # fmt: skip
        self.watch._take(Sample(self.watch.keys.robot(robot_id, Topic.STATE), wire.encode(state)))

    def broken(self, invariant: Invariant) -> bool:
        """Tell whether an invariant was seen broken."""
        return bool(self.watch.findings.of(invariant))

    def _header(self) -> dict[str, Any]:
        return {"v": 1, "boot": "b", "seq": 0, "stamp_s": self.now_s}


def test_robots_in_reach_that_come_too_close_are_seen() -> None:
    sky = Sky()
    sky.pass_by(FAR)
    sky.pass_by(NEAR)
    assert sky.broken(Invariant.SEPARATION)


@pytest.mark.parametrize("way", ["away", "jammed"])
def test_a_robot_that_comes_back_near_another_must_part_and_then_keep_apart(way: str) -> None:
    sky = Sky()
    sky.pass_by(FAR)
    sky.watch.away |= {24} if way == "away" else set()
    sky.pass_by(NEAR, jammed=way == "jammed")
    sky.watch.away.clear()
    sky.pass_by(NEAR, seconds=2.0)
    sky.pass_by(FAR)
    assert not sky.broken(Invariant.SEPARATION)
    sky.pass_by(NEAR)
    assert sky.broken(Invariant.SEPARATION)


def test_a_robot_that_comes_back_near_another_and_stays_there_is_seen() -> None:
    sky = Sky()
    sky.watch.away.add(24)
    sky.pass_by(NEAR)
    sky.watch.away.clear()
    sky.pass_by(NEAR, seconds=PART_S + 1.0)
    assert sky.broken(Invariant.SEPARATION)


def test_a_robot_that_leaves_a_jam_in_a_silence_holds_within_a_second_of_that() -> None:
    sky = Sky()
    with sky.watch.silence((23, 24), sky.now_s, dead=False):
        sky.pass_by(FAR, jammed=True, seconds=0.9)
        jammed_s, sky.watch.truth = sky.now_s, None
        sky.now_s = jammed_s + 0.9
        sky.say(24, wire.Mode.FLYING)
        assert not sky.broken(Invariant.HOLD)
        sky.now_s = jammed_s + 1.1
        sky.say(24, wire.Mode.FLYING)
        assert sky.broken(Invariant.HOLD)


def told(time_s: float, *given: int, state: str = "running") -> dict[str, Any]:
    """Return what of a snapshot tells who has a robot; there are two targets."""
    directives = {"weights": {}, "weight_bounds": {}, "severities": {}, "capacities": {"21": 2}}
    return {
        "type": "snapshot",
        "tick": 0,
        "time_s": time_s,
        "state": state,
        "directives": directives | {"assignment": {"21": list(given)}},
        "targets": [{"id": 101}, {"id": 102}],
        "robots": [{"link": "connected"}],
    }


@pytest.mark.parametrize(
    ("snapshots", "broken"),
    [
        ([told(1.0, 101, 102), told(1.1, 101), told(1.2, 101, 102)], False),
        ([told(0.1 * n, 101) for n in range(30)], True),
        ([told(0.1 * n, 101, state="held") for n in range(30)], False),
        # Nobody saw what was between.
        ([told(1.0, 101, 102), told(1.2 + COVERED_S, 101), told(1.3 + COVERED_S, 101, 102)], False),
        ([told(1.0, 101), told(1.2 + COVERED_S, 101), told(1.3 + COVERED_S, 101, 102)], False),
    ],
)
def test_only_what_is_seen_all_the_while_is_a_target_left_alone(
    snapshots: list[dict[str, Any]], broken: bool
) -> None:
    ear = Ear("", {}, Findings())
    for said in snapshots:
        ear._take(said)
    assert bool(ear.findings.of(Invariant.BOUNDS)) is broken


def test_an_alarm_that_is_raised_again_between_two_looks_is_news() -> None:
    ear = Ear("", {}, Findings())
    alarm = {"id": "planner", "count": 1, "active": True, "last_s": 5.0, "severity": "alarm"}
    for last_s in (5.0, 5.0, 80.0):
        ear._compare([alarm | {"text": "The planner has ended", "last_s": last_s}])
    assert len(ear.told) == 2
