"""Why a robot does what it does, in facts from the prompt."""

import math

from llm.mock.reading import Reading, SeenRobot, SeenTarget

NEAR_ZONE_M = 1.0
STILL_M_S = 0.05


def explain(reading: Reading, robot: SeenRobot) -> str:
    """Say what a robot does and what holds it, in facts from the prompt."""
    name = f"Drone {robot.id}"
    if robot.lost:
        return f"{name} is lost."
    if robot.cut_off:
        return f"{name} is cut off by a communication failure and flies on board."
    commanded = math.hypot(*robot.commanded)
    parts = [f"{name} moves at {speed_m_s(robot):.2f} m/s, commanded {commanded:.2f} m/s"]
    if robot.still is not None:
        parts.append(f"it has moved {robot.still[0]:.2f} m in the last {robot.still[1]:g} s")
    if robot.blind:
        parts.append("it is in sensing failure and sees no target")
    parts.extend(_held_by(reading, robot))
    if reading.rung is not None:
        parts.append(f"the last optimization ended {reading.rung}")
    return f"{'; '.join(parts)}."


def _held_by(reading: Reading, robot: SeenRobot) -> list[str]:
    targets = {target.id: target for target in reading.targets}
    mine = [targets[t] for t in robot.row if t in targets and targets[t].position]
    parts = []
    for zone in reading.zones:
        gap = math.dist(robot.position, zone.position) - zone.keep_out_m
        if gap < NEAR_ZONE_M:
            where = f"{gap:.1f} m outside" if gap >= 0.0 else f"{-gap:.1f} m inside"
            parts.append(f"it is {where} the keep-out of {zone.kind} zone {zone.label}")
            inside = [
                f"Target {t.id}"
                for t in mine
                if t.position and math.dist(t.position, zone.position) < zone.keep_out_m
            ]
            if inside:
                parts.append(f"{' and '.join(inside)} is inside that zone")
    parts.extend(_distance_words(robot, target) for target in mine)
    if not robot.row:
        parts.append("it has no target")
    return parts


def _distance_words(robot: SeenRobot, target: SeenTarget) -> str:
    away = math.dist(robot.position, target.position or robot.position)
    return f"Target {target.id} is {away:.1f} m away"


def stands_still(robot: SeenRobot) -> bool:
    """Return whether a robot does not get anywhere: now, or for some time."""
    return robot.still is not None or speed_m_s(robot) < STILL_M_S


def speed_m_s(robot: SeenRobot) -> float:
    """Return a robot's speed, m/s."""
    return math.hypot(*robot.velocity)
