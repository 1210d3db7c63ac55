"""Structured logs on standard error; standard output belongs to results."""

import logging
import os
import sys

import structlog
from structlog.typing import Processor

FORMAT_VARIABLE = "FALCONER_LOG_FORMAT"


def configure_logs(level: int = logging.INFO) -> None:
    """Write one line per event to standard error: to be read, or as JSON where that is set.

    The variable is read here, since every process of ours logs and not each has settings.
    """
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    structlog.configure(
        processors=[*shared, *_renderers()],
        wrapper_class=structlog.make_filtering_bound_logger(level),
        logger_factory=structlog.PrintLoggerFactory(file=sys.stderr),
        cache_logger_on_first_use=False,
    )


def _renderers() -> list[Processor]:
    if os.environ.get(FORMAT_VARIABLE, "").lower() == "json":
        return [structlog.processors.dict_tracebacks, structlog.processors.JSONRenderer()]
    return [
        structlog.dev.ConsoleRenderer(
            colors=sys.stderr.isatty(),
            exception_formatter=structlog.dev.plain_traceback,
        )
    ]
