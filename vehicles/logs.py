"""Structured logs on standard error; standard output belongs to results."""

import logging
import os
import sys

import structlog
from structlog.typing import Processor

FORMAT_VARIABLE = "FALCONER_LOG_FORMAT"


class _Forwarder(logging.Handler):
    """Passes on what is logged by other means: by the floors below us, and by libraries."""

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a record on. Never raises: whoever logs has other things to do."""
        level = max(logging.DEBUG, min(logging.CRITICAL, record.levelno // 10 * 10))
        said = {"exc_info": record.exc_info} if record.exc_info else {}
        try:
            structlog.get_logger(record.name).log(level, record.getMessage(), **said)
        except Exception:  # noqa: BLE001 - as every handler of the standard library does
            self.handleError(record)


def configure_logs(libraries: int = logging.WARNING) -> None:
    """Write one line per event to standard error: to be read, or as JSON where that is set.

    The variable is read here, since every process of ours logs and not each has settings.
    `libraries` is the least level of what is told of events that are not logged by structlog.
    """
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.processors.add_log_level,
        structlog.processors.TimeStamper(fmt="iso", utc=True),
    ]
    structlog.configure(
        processors=[*shared, *_renderers()],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=lambda *_: structlog.PrintLogger(sys.stderr),
        cache_logger_on_first_use=False,
    )
    root = logging.getLogger()
    for handler in [known for known in root.handlers if isinstance(known, _Forwarder)]:
        root.removeHandler(handler)
    root.addHandler(_Forwarder())
    root.setLevel(libraries)


def _renderers() -> list[Processor]:
    if os.environ.get(FORMAT_VARIABLE, "").lower() == "json":
        return [structlog.processors.dict_tracebacks, structlog.processors.JSONRenderer()]
    return [
        structlog.dev.ConsoleRenderer(
            colors=sys.stderr.isatty(),
            exception_formatter=structlog.dev.plain_traceback,
        )
    ]
