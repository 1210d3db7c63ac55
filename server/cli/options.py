"""Option values that need more than a type."""

import math
from enum import StrEnum
from typing import Annotated

import typer

from server.cli.errors import UsageError
from server.lockstep.job import PAPER_LATENCY, Latency, ScriptedComment
from server.mission.setup import GateMode

MAX_COMMENT_CHARS = 2000


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="A file, a name such as demo, or one of the paper authors' experiment files.",
    ),
]
LlmOption = Annotated[
    str,
    typer.Option(
        "--llm",
        metavar="mock|local|exact|none|URL",
        help="Who advises: the built-in rule model, the small language model on this machine, "
        "our assignment solver, nobody, or an OpenAI-compatible endpoint "
        "(model and key from FALCONER_LLM_MODEL and FALCONER_LLM_API_KEY).",
    ),
]

SeedOption = Annotated[
    int | None, typer.Option(min=0, max=2**63 - 1, help="World's dice; default: the file's.")
]
StepsOption = Annotated[
    int | None, typer.Option(min=1, max=1_000_000, help="Steps to run; default: the file's.")
]


class EngineName(StrEnum):
    """Optimizers to choose from."""

    FAST = "fast"
    SQP = "sqp"
    IPOPT = "ipopt"


GateOption = Annotated[
    GateMode | None,
    typer.Option(
        "--gate", help="What a verified proposal must still pass; default: the scenario's."
    ),
]
EngineOption = Annotated[
    EngineName | None, typer.Option("--engine", help="Optimizer; default: the best.")
]
LatencyOption = Annotated[
    str,
    typer.Option(
        "--llm-latency",
        metavar="paper|measured|SECONDS",
        help="Virtual seconds an answer takes in lockstep.",
    ),
]


def finite(value: float | None) -> float | None:
    """Return an option's number. Raises typer.BadParameter for what no range keeps out."""
    if value is not None and not math.isfinite(value):
        raise typer.BadParameter(f"{value} is not a finite number")
    return value


def scripted_comments(values: list[str]) -> tuple[ScriptedComment, ...]:
    """Return the comments of `--comment "T:TEXT"` options, ordered by time.

    Raises UsageError naming the value that does not fit.
    """
    comments = []
    for value in values:
        head, colon, text = value.partition(":")
        try:
            time_s = float(head)
        except ValueError:
            time_s = math.nan
        if not colon or not math.isfinite(time_s) or time_s < 0.0:
            raise UsageError(
                f"--comment {value[:60]!r}: expected T:TEXT with T in mission seconds, 0 or more"
            )
        text = text.strip()
        if not 1 <= len(text) <= MAX_COMMENT_CHARS:
            raise UsageError(
                f"--comment at {head} s: the text has {len(text)} characters, "
                f"allowed are 1 to {MAX_COMMENT_CHARS}"
            )
        comments.append(ScriptedComment(time_s, text))
    return tuple(sorted(comments, key=lambda comment: comment.time_s))


def latency_option(value: str) -> Latency:
    """Return the latencies of `--llm-latency paper|measured|SECONDS`."""
    if value == "paper":
        return PAPER_LATENCY
    if value == "measured":
        return Latency(None, None)
    try:
        seconds = float(value)
    except ValueError:
        seconds = math.nan
    if not 0.0 <= seconds <= 600.0:
        raise UsageError(
            f"--llm-latency {value!r}: expected paper, measured or seconds from 0 to 600"
        )
    return Latency(seconds, seconds)
