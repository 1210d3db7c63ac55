"""Results as tables for people."""

from typing import Any

from rich.table import Table

_ROWS = (
    ("accumulated_trace", "accumulated trace", "m²"),
    ("accumulated_trace_authors", "… by the authors' accounting", "m²"),
    ("position_error_m", "mean position error", "m"),
    ("sensing_attacks", "sensing attacks", ""),
    ("communication_attacks", "communication attacks", ""),
    ("trajectory_length_m", "trajectory length", "m"),
    ("min_separation_m", "smallest separation", "m"),
    ("wall_s", "wall time", "s"),
)


def result_table(result: dict[str, Any]) -> Table:
    """Return a run's result as a table."""
    title = f"{result['scenario']}, seed {result['seed']}, {result['steps']} steps"
    table = Table(title=title, show_header=False)
    for key, label, unit in _ROWS:
        if key in result:
            table.add_row(label, _number(result[key]), unit)
    optimizer = result["optimizer"]
    table.add_row("optimizer median / p99", _pair(optimizer, "median_ms", "p99_ms"), "ms")
    table.add_row("optimizer success", _percent(optimizer["success_rate"]), "")
    for key, label in (("task_llm", "task model"), ("action_llm", "action model")):
        loop = result[key]
        if loop["calls"]:
            first = _percent(loop["valid_first"] / loop["calls"])
            table.add_row(f"{label} calls / adopted", f"{loop['calls']} / {loop['adopted']}", "")
            table.add_row("… valid at first / after retries", _valid(first, loop), "")
            table.add_row("… tokens in / out of a call", _tokens(loop), "")
    return table


def warning_lines(result: dict[str, Any]) -> list[str]:
    """Return what a reader of the figures should know first."""
    return [
        f"warning: no answer of the {label} was valid in {result[key]['calls']} calls"
        for key, label in (("task_llm", "task model"), ("action_llm", "action model"))
        if result[key]["calls"] and not result[key]["valid"]
    ]


def comment_lines(result: dict[str, Any]) -> list[str]:
    """Return what became of each comment, a line each."""
    lines = []
    for comment in result["comments"]:
        said = [
            f"{loop}: {comment[loop]['reason']}"
            for loop in ("task", "action")
            if comment[loop] is not None and comment[loop]["reason"]
        ]
        answer = "; ".join(said) or "no answer"
        lines.append(f"{comment['time_s']:g} s {comment['text']!r} {comment['status']}: {answer}")
    if lines:
        rows = ", ".join(
            f"{robot} -> {list(row)}" for robot, row in result["directives"]["assignment"].items()
        )
        lines.append(f"assignment at the end: {rows} (beta = {result['directives']['beta']})")
    return lines


def _number(value: float | int | None) -> str:
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3f}"


def _pair(values: dict[str, float | None], first: str, second: str) -> str:
    return f"{_number(values[first])} / {_number(values[second])}"


def _valid(first: str, loop: dict[str, Any]) -> str:
    return f"{first} / {_percent(loop['success_rate'])}"


def _tokens(loop: dict[str, Any]) -> str:
    return f"{loop['mean_tokens_in']:.0f} / {loop['mean_tokens_out']:.0f}"


def _percent(value: float | None) -> str:
    return "-" if value is None else f"{100.0 * value:.1f} %"
