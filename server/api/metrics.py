"""Figures for Prometheus, read off the service when asked for (docs/reference/metrics.md).

Nothing is counted twice: what a mission's process knows it tells once a second, the rest is the
newest snapshot and the service's own state.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST, CollectorRegistry, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from server.api.missions import service_of
from server.api.record import MissionRecord
from server.api.service import MissionService
from server.encoding import MissionState
from server.live.vitals import process_vitals

router = APIRouter(tags=["health"])

_LOOP_GAUGES: Final = (
    ("rate_hz", "falconer_loop_rate_hz", "Calls per second."),
    ("mean_s", "falconer_loop_seconds", "Mean run time of a call."),
    ("success_rate", "falconer_loop_success_ratio", "Share of the last calls that succeeded."),
    ("age_s", "falconer_loop_age_seconds", "Since the last success."),
)
_LOOP_COUNTERS: Final = (
    ("calls", "falconer_loop_calls", "Calls."),
    ("missed", "falconer_loop_missed", "Ticks that were skipped because one was late."),
)
_LLM_COUNTERS: Final = (
    ("calls", "falconer_llm_calls", "Logical calls."),
    ("tries", "falconer_llm_tries", "Requests."),
    ("valid", "falconer_llm_valid", "Valid answers."),
    ("adopted", "falconer_llm_adopted", "Answers that went into force."),
    ("tokens_in", "falconer_llm_tokens_in", "Tokens of prompts."),
    ("tokens_out", "falconer_llm_tokens_out", "Tokens of answers."),
    ("seconds", "falconer_llm_seconds", "Time from question to verdict."),
)
_PROCESS_GAUGES: Final = (
    ("resident_bytes", "falconer_process_resident_bytes", "Memory of a process."),
    ("tasks", "falconer_process_tasks", "asyncio tasks of a process."),
    ("threads", "falconer_process_threads", "Threads of a process."),
)


@router.get("/metrics", response_class=Response)
async def metrics(request: Request) -> Response:
    """Return the figures in Prometheus's text format."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(ServiceCollector(service_of(request)))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_LATEST)


class ServiceCollector(Collector):
    """Reads the figures of one service."""

    def __init__(self, service: MissionService) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        """Yield all of them."""
        service = self._service
        yield from _journal(service)
        records = service.records()
        yield _gauge("falconer_missions", "Missions kept, by state.", "state", _states(records))
        clients = sum(record.fanout.readers for record in records)
        dropped = sum(record.fanout.dropped for record in records)
        yield _single("falconer_stream_clients", "Open subscriptions of streams.", clients)
        text = "Subscriptions closed because they were too slow."
        yield _counted("falconer_stream_clients_dropped", text, dropped)
        live = next((r for r in records if r.live and r.real), None)
        processes = {"web": process_vitals()}
        if live is not None:
            yield from _mission(live)
            processes["mission"] = live.vitals.get("process", {})
        for key, name, text in _PROCESS_GAUGES:
            values = {p: known[key] for p, known in processes.items() if key in known}
            yield _gauge(name, text, "process", values)


def _journal(service: MissionService) -> Iterator[Metric]:
    status = service.journal
    text = "Whether entries can be committed."
    yield _single("falconer_journal_available", text, float(status.available))
    yield _counted("falconer_journal_entries", "Entries committed.", status.head.seq)
    yield _single("falconer_journal_waiting", "Entries not committed yet.", status.waiting)
    text = "Entries for which there was no room while the database was away."
    yield _counted("falconer_journal_lost", text, status.lost)


def _mission(record: MissionRecord) -> Iterator[Metric]:
    """Yield the live mission's figures."""
    vitals = record.vitals
    for key, name, text in _LLM_COUNTERS:
        values = {loop: known[key] for loop, known in vitals.get("llm", {}).items()}
        yield _counters(name, f"{text} Of the model, per loop.", "loop", values)
    text = "Messages or events that were refused or found no room, by what they were."
    yield _counters("falconer_dropped", text, "what", vitals.get("counters", {}))
    snapshot = record.snapshot
    if snapshot is None:
        return
    loops: dict[str, dict[str, Any]] = snapshot["loops"]
    for key, name, text in _LOOP_COUNTERS:
        yield _counters(name, text, "loop", {loop: f[key] for loop, f in loops.items()})
    for key, name, text in _LOOP_GAUGES:
        known = {loop: f[key] for loop, f in loops.items() if f[key] is not None}
        yield _gauge(name, text, "loop", known)
    solve = snapshot["solve"]
    if solve is not None:
        seconds = (solve["solve_ms"] or 0.0) / 1e3
        yield _single("falconer_solve_seconds", "Thread time of the newest solve.", seconds)
        iterations = solve["iterations"]
        yield _single("falconer_solve_iterations", "Iterations of the newest solve.", iterations)
    links: dict[str, float] = {"connected": 0.0, "jammed": 0.0, "lost": 0.0}
    for robot in snapshot["robots"]:
        links[robot["link"]] += 1.0
    yield _gauge("falconer_robots", "Robots, by how they are reached.", "link", links)
    yield _single("falconer_trace", "Uncertainty of the team, m2.", snapshot["trace"] or 0.0)
    hits: dict[str, float] = snapshot["attacks"]
    yield _counters("falconer_attacks", "Hits by zones.", "kind", hits)
    yield _single("falconer_mission_seconds", "Mission time.", snapshot["time_s"] or 0.0)


def _states(records: list[MissionRecord]) -> dict[str, float]:
    return {s.value: float(sum(r.state is s for r in records)) for s in MissionState}


def _single(name: str, text: str, value: float) -> Metric:
    return GaugeMetricFamily(name, text, value=float(value))


def _counted(name: str, text: str, value: float) -> Metric:
    return CounterMetricFamily(name, text, value=float(value))


def _gauge(name: str, text: str, label: str, values: Mapping[str, float]) -> Metric:
    family = GaugeMetricFamily(name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], float(value))
    return family


def _counters(name: str, text: str, label: str, values: Mapping[str, float]) -> Metric:
    family = CounterMetricFamily(name, text, labels=[label])
    for key, value in values.items():
        family.add_metric([key], float(value))
    return family
