"""The choices a prompt is written by."""

from enum import StrEnum


class Loop(StrEnum):
    """Which of the two models is asked."""

    TASK = "task"
    ACTION = "action"


class AnswerForm(StrEnum):
    """How the answer is to be written. Both forms are always understood."""

    JSON = "json"
    LINES = "lines"


class PromptStyle(StrEnum):
    """How much is told and offered."""

    FULL = "full"
    COMPACT = "compact"
    """For small models: no states in the history, no optional proposals, weights in steps."""


class Examples(StrEnum):
    """Whether worked examples stand in the prompt (the paper tries both)."""

    WITHOUT = "without"
    WITH = "with"
