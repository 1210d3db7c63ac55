"""How each command of the documentation is run, and which few are run elsewhere.

Nothing is passed over in silence: a command that no rule covers fails the tests, and so does a
rule that covers nothing.
"""

import re
from dataclasses import dataclass
from enum import StrEnum

from tests.docs.blocks import Block


class Way(StrEnum):
    """How a statement is run."""

    DONE = "run to its end; must exit with 0"
    LIVE = "started, waited for until it is up, ended by Ctrl-C"
    SHELL = "given to a shell"
    REQUEST = "a request to the server that the page has started"
    ELSEWHERE = "run by another test"
    BY_HAND = "tried by hand"
    SYSTEM = "a tool of the machine: read by a shell, not run"


ELSEWHERE = {
    r"make run": "tests/house/test_targets.py",
    r"make test": "tests/house/test_targets.py",
    r"make chaos.*|python -m tests\.chaos .*": "tests/chaos/test_chaos.py",
    r"make field": "tests/benchmarks/test_field.py",
    r"make bench": "tests/benchmarks/test_performance.py",
    r"make mixed": "tests/house/test_scripts.py",
    r"make setup-local": "tests/house/test_scripts.py",
    r"docker compose .*": "tests/server/scripts/test_compose.py",
    r"issue (planner \"IP:|site ).*": "tests/server/test_deploy.py",
    r"openssl .*|issue.*|\}": "tests/server/test_bus.py",
    r"falconer run hardware (--lockstep )?--llm local.*": "tests/llm/local/test_model.py",
    r"falconer experiment reasoning .*": "tests/server/cli/test_experiments.py",
    r"falconer experiment .*exp4\.yaml.*": "tests/server/cli/test_experiments.py",
    r"falconer vehicle order .*": "tests/server/cli/test_vehicle.py",
    r"python -m benchmarks\.adversarial .*": "tests/solver/engines/test_fast_engine.py",
    r"python -m benchmarks\.agreement .*": "tests/benchmarks/test_performance.py",
    r"python -m benchmarks\.assignment .*": "tests/benchmarks/test_assignment.py",
    r"python -m benchmarks\.(bus|reaction) .*": "tests/benchmarks/test_bus.py",
    r"python -m benchmarks\.crowd": "tests/benchmarks/test_crowd.py",
    r"python -m benchmarks\.discovery .*": "tests/benchmarks/test_discovery.py",
    r"python -m benchmarks\.estimation .*": "tests/benchmarks/test_estimation.py",
    r"python -m benchmarks\.gate .*": "tests/benchmarks/test_gate.py",
    r"python -m benchmarks\.misbehaviour .*": "tests/benchmarks/test_misbehaviour.py",
    r"python -m benchmarks\.injections": "tests/llm/test_injections.py",
    r"python -m benchmarks\.localization .*": "tests/vehicles/localization/test_ukf.py",
    r"python -m benchmarks\.mixed .*": "tests/benchmarks/test_mixed.py",
    r"python -m benchmarks\.quality .*": "tests/benchmarks/test_quality.py",
    r"python -m tests\.vehicles\.fuzzing .*": "tests/vehicles/test_fuzzing.py",
    r"python -m tests\.vehicles\.mavlink\.fuzzing .*": "tests/vehicles/mavlink/test_fuzzing.py",
    r"python -m pytest tests/faults .*": "tests/faults/test_faults.py",
}
"""What takes too long, installs or needs other machines: who runs the same, shorter."""

BY_HAND = {r"mavproxy\.py .*": "too large a dependency; the page says when it was last tried"}

SHORTER = {
    r"falconer experiment ablation .*": {"--seeds": "1", "--steps": "5", "--jobs": "1"},
    r"falconer experiment runtime .*": {"--duration": "5"},
    r"falconer experiment scaling .*": {"--largest": "4", "--seeds": "1", "--steps": "12"},
    r"falconer run hardware --lockstep --comment .*": {"--steps": "320"},
    r"falconer run ablation --lockstep --llm http.*": {"--steps": "100"},
    r"falconer run unseen --lockstep .*": {"--steps": "100"},
}
"""Campaigns and long flights, run as they stand but for these options."""

LIVE = (
    r"falconer (run|serve|sim|router|mock-llm)\b(?!.* --(lockstep|show)\b).*",
    r"falconer vehicle (mavlink|sim|sim-autopilot)\b.*",
    r"falconer replay \S+",
)
"""What goes on until it is ended."""

KEPT = ("falconer serve", "falconer mock-llm --port 8081")
"""Live ones that stay up to the end of their page, for what follows there."""

NEEDED = {
    r"falconer .*http://127\.0\.0\.1:8081/v1.*": "falconer mock-llm --port 8081",
    r".*FALCONER_LLM_BASE_URL\"": "falconer mock-llm --port 8081",
    r"falconer script .*": "falconer serve",
    r"falconer (sim|vehicle (mavlink|sim))\b.*": (
        "falconer router hardware --listen tcp/127.0.0.1:7447"
    ),
}
"""What must be up before; started where the page has not done so itself."""

REFUSED = {r".*/alarms/link-21/acknowledge": "alarm_unknown"}
"""Requests about what only a long flight has, and what they are answered with before."""

SYSTEM = (
    r"(sudo )?(apt-get|caddy|chronyc|install|ip|journalctl|nginx|scp|ssh|sudo|systemctl|"
    r"timedatectl|ufw|useradd|zenohd)\b.*"
)
"""What changes the reader's machine and is not ours."""

SHELL = (r"export [A-Z_]+=\S+", r"[a-z]+=\S+", r"alias \w+=.*")
LANGUAGES = (
    *("caddyfile", "conf", "ini", "json", "json5", "nginx", "python", "systemd"),
    *("text", "toml", "yaml"),
)
"""Of blocks that are no commands; `text` is a drawing, an equation or what a program says."""


@dataclass(frozen=True, slots=True)
class Rule:
    """How one statement is run."""

    way: Way
    by: str = ""
    """The test that does it elsewhere, or why it is done by hand."""


def matches(pattern: str, statement: str) -> bool:
    """Tell whether a rule's pattern covers a whole statement."""
    return re.fullmatch(pattern, statement) is not None


def rule_of(statement: str) -> Rule:
    """Return how a statement is run. Raises LookupError where nothing says so."""
    for table, way in ((ELSEWHERE, Way.ELSEWHERE), (BY_HAND, Way.BY_HAND)):
        for pattern, by in table.items():
            if matches(pattern, statement):
                return Rule(way, by)
    if any(matches(pattern, statement) for pattern in LIVE):
        return Rule(Way.LIVE)
    if statement.startswith("falconer "):
        return Rule(Way.DONE)
    if matches(SYSTEM, statement):
        return Rule(Way.SYSTEM)
    if statement.startswith("curl "):
        return Rule(Way.REQUEST)
    if any(matches(pattern, statement) for pattern in SHELL):
        return Rule(Way.SHELL)
    raise LookupError(f"no rule covers: {statement}")


def statements_of(block: Block) -> list[str]:
    """Return a shell block's statements, the command named as if it were on the path."""
    return [re.sub(r"^\.venv/bin/", "", each) for each in block.statements()]


def shortened(statement: str) -> str:
    """Return a statement with the options that make a campaign short."""
    for pattern, options in SHORTER.items():
        if matches(pattern, statement):
            for option, value in options.items():
                statement = re.sub(rf" {option} \S+", "", statement) + f" {option} {value}"
    return statement
