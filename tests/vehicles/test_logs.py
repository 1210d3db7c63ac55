"""One line per event, whoever tells of it."""

import json
import os
import subprocess
import sys

TELL = """
import logging
import structlog
from vehicles.logs import configure_logs

configure_logs()
configure_logs()
structlog.get_logger().info("a mission flies", mission="m1")
below = logging.getLogger("solver.planner")
below.info("nobody wants to know")
below.warning("engine %s failed: %s", "fast", "no numbers")
try:
    1 / 0
except ZeroDivisionError:
    below.exception("it broke")
"""


def told(form: str) -> list[str]:
    environment = {**os.environ, "FALCONER_LOG_FORMAT": form}
    done = subprocess.run(
        [sys.executable, "-c", TELL], env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout == ""
    return done.stderr.splitlines()


def test_programs_get_an_object_per_line_of_every_floor() -> None:
    lines = [json.loads(line) for line in told("json")]
    assert [(line["level"], line["event"]) for line in lines] == [
        ("info", "a mission flies"),
        ("warning", "engine fast failed: no numbers"),
        ("error", "it broke"),
    ]
    assert lines[2]["exception"][0]["exc_type"] == "ZeroDivisionError"
    assert all(line["timestamp"] for line in lines)


def test_people_get_words() -> None:
    lines = told("text")
    assert "a mission flies" in lines[0]
    assert "warning" in lines[1]
    assert "engine fast failed: no numbers" in lines[1]
    assert "ZeroDivisionError: division by zero" in lines[-1]
