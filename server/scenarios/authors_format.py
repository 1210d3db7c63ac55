"""The format of the paper authors' experiment files, checked in its own names.

Lists may be longer than what they are for (their program never looks at the rest), not
shorter. Keys without effect there are ignored here.
"""

from collections import Counter
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from server.scenarios.errors import Problem
from server.scenarios.parts import MAX_VARIANCE_M2, MIN_VARIANCE_M2, Coordinate, Id, Point, Seconds

Rows = tuple[tuple[Coordinate, ...], ...]
Bit = Literal[0, 1]
Variance = Annotated[float, Field(strict=True, ge=MIN_VARIANCE_M2, le=MAX_VARIANCE_M2)]
Share = Annotated[float, Field(strict=True, gt=0.0, lt=1.0)]
Count = Annotated[int, Field(strict=True, ge=0, le=256)]
NotNegative = Annotated[float, Field(strict=True, ge=0.0, le=1e6)]
Weight = Annotated[float, Field(strict=True, ge=1e-6, le=1e6)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True, allow_inf_nan=False)


class ProblemSection(_Part):
    """Their section `Problem`: team, targets, optimizer."""

    dim: Literal[2]
    stages: Annotated[int, Field(strict=True, ge=2, le=51)] = Field(alias="N")
    """Stages of the problem: one more than steps ahead."""

    dt: Seconds
    robot_ids: tuple[Id, ...] = Field(alias="robotID", min_length=1, max_length=1000)
    target_ids: tuple[Id, ...] = Field(alias="targetID", min_length=1, max_length=2000)
    robot_positions: Rows = Field(alias="robotStartPos")
    target_positions: Rows = Field(alias="targetStartPos")
    target_velocities: Rows = Field(alias="targetStartVel")
    target_dynamics: Literal["second_order_dynamics"] = Field(alias="target_dyn_type")
    """Targets keep their velocity."""

    robot_dynamics: Literal["first_order_dynamics"] = Field(alias="robot_dyn_type")
    """Robots are velocity controlled."""

    assignment_matrix: tuple[tuple[Bit, ...], ...]
    task_ability: Annotated[int, Field(strict=True, ge=0, le=1000)]
    heights: tuple[Annotated[float, Field(strict=True, ge=0.0, le=1000.0)], ...] = Field(
        default=(), alias="robotHeights"
    )
    u_bounds: Point
    x_bounds: tuple[Point, Point]
    weights: tuple[Weight, Weight, Weight, Weight]
    """In their order: control, trace, slack of sensing zones, slack of communication zones."""

    range_sensor: tuple[NotNegative, NotNegative]
    bearing_sensor: tuple[NotNegative, NotNegative]
    """Peak and shape."""

    min_dist: NotNegative


class ZonesSection(_Part):
    """Their section `Zones`: type I takes away sensing, type II communication."""

    sensing_count: Count = Field(alias="nTypeI")
    communication_count: Count = Field(alias="nTypeII")
    sensing_means: Rows = Field(default=(), alias="typeI_mu")
    sensing_variances: tuple[tuple[Variance, ...], ...] = Field(default=(), alias="typeI_cov")
    sensing_margins: tuple[NotNegative, ...] = Field(default=(), alias="typeI_delta")
    communication_means: Rows = Field(default=(), alias="typeII_mu")
    communication_variances: tuple[tuple[Variance, ...], ...] = Field(
        default=(), alias="typeII_cov"
    )
    communication_margins: tuple[NotNegative, ...] = Field(default=(), alias="typeII_delta")
    eps1: Annotated[float, Field(strict=True, gt=0.0, le=0.5)]
    eps2: Annotated[float, Field(strict=True, ge=0.5, lt=1.0)]
    """Confidence, not risk: near 1 is careful."""

    eps2_single: Annotated[float, Field(strict=True, gt=0.0, le=0.5)]
    attack_recover_eps: Annotated[float, Field(strict=True, gt=0.0, le=1e6)]
    attack_dt: Seconds
    attack_seed: Annotated[int, Field(strict=True, ge=0, le=2**63 - 1)]


class ExperimentFile(_Part):
    """The file: how long it runs, how often the models are asked, and the two sections."""

    steps: Annotated[int, Field(strict=True, ge=1, le=1_000_000)]
    llm_inner_dur: Seconds
    """Period of the action model."""

    llm_outer_dur: Seconds
    """Period of the task model."""

    problem: ProblemSection = Field(alias="Problem")
    zones: ZonesSection = Field(alias="Zones")


def misfits(file: ExperimentFile) -> Iterator[Problem]:
    """Yield lists of the wrong length and ids that repeat, in the file's own names."""
    problem, zones = file.problem, file.zones
    robots, targets = len(problem.robot_ids), len(problem.target_ids)
    yield from _rows("Problem.robotStartPos", problem.robot_positions, robots)
    yield from _rows("Problem.targetStartPos", problem.target_positions, targets)
    yield from _rows("Problem.targetStartVel", problem.target_velocities, targets)
    for key, ids in (("robotID", problem.robot_ids), ("targetID", problem.target_ids)):
        for repeated in (one for one, count in Counter(ids).items() if count > 1):
            yield Problem(f"Problem.{key}", f"{repeated} stands here twice; ids are unique")
    yield from _matrix(problem)
    first, second = zones.sensing_count, zones.communication_count
    yield from _rows("Zones.typeI_mu", zones.sensing_means, first)
    yield from _rows("Zones.typeI_cov", zones.sensing_variances, first)
    yield from _enough("Zones.typeI_delta", zones.sensing_margins, first)
    yield from _rows("Zones.typeII_mu", zones.communication_means, second)
    yield from _rows("Zones.typeII_cov", zones.communication_variances, second)
    yield from _enough("Zones.typeII_delta", zones.communication_margins, second)


def _matrix(problem: ProblemSection) -> Iterator[Problem]:
    rows, columns = len(problem.robot_ids), len(problem.target_ids)
    key = "Problem.assignment_matrix"
    if len(problem.assignment_matrix) != rows:
        count = len(problem.assignment_matrix)
        yield Problem(key, f"has {count} rows, one per robot is needed ({rows})")
    for i, row in enumerate(problem.assignment_matrix):
        if len(row) != columns:
            yield Problem(
                f"{key}[{i}]", f"has {len(row)} entries, one per target is needed ({columns})"
            )
        elif sum(row) > problem.task_ability:
            yield Problem(
                f"{key}[{i}]",
                f"gives the robot {sum(row)} targets, but task_ability is "
                f"{problem.task_ability} (allowed: {problem.task_ability} or fewer)",
            )


def _enough(key: str, values: tuple[object, ...], count: int) -> Iterator[Problem]:
    if len(values) < count:
        yield Problem(key, f"has {len(values)} entries, {count} or more are needed")


def _rows(key: str, rows: tuple[tuple[float, ...], ...], count: int) -> Iterator[Problem]:
    yield from _enough(key, rows, count)
    for i, row in enumerate(rows[:count]):
        if len(row) != 2:
            yield Problem(
                f"{key}[{i}]", f"has {len(row)} entries, exactly 2 are needed (only the plane)"
            )
