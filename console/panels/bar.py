"""The top bar: mission, clock, the three loops' lamps, who guides."""

from console.board import Facts
from console.panel import Panel
from console.render import Json, clock, escape
from server.api.models import MissionInfo

LOOPS = (("optimizer", "Optimizer"), ("task_llm", "Task model"), ("action_llm", "Action model"))
STALE_PERIODS = 3.0
"""A loop whose last success is older than so many of its periods wants to be looked at."""

PERIODS_S = {"optimizer": 0.1, "task_llm": 20.0, "action_llm": 5.0}
"""Between two calls, where the loop does not say that it takes longer."""

GOOD_SUCCESS = 0.8

LEVEL_WORDS = {"ok": "normal", "warn": "low success", "alarm": "stale", "idle": "idle"}

GUIDANCE_WORDS = {
    "model": "Model guidance",
    "last_valid": "Last valid guidance",
    "solver": "Own solver",
    "hold": "Hold",
}
NO_MISSION = "<b>No mission</b><small>Create one by the API or by falconer run.</small>"


class MissionPanel(Panel):
    """What flies, in which state, and since when."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the mission's line and its clock."""
        pieces = {"mission": mission_line(facts.mission)}
        if facts.snapshot is not None:
            pieces["clock"] = mission_clock(facts.snapshot, facts.silent_s)
        return pieces

    def build(self) -> None:
        """Show both."""
        self.html("mission", "mission")
        self.html("clock", "clock")


class LampsPanel(Panel):
    """How the three loops do."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the lamps."""
        if facts.snapshot is None:
            return {}
        return {"lamps": lamps(facts.snapshot, facts.silent_s)}

    def build(self) -> None:
        """Show them."""
        self.html("lamps", "lamps")


class GuidancePanel(Panel):
    """Which step of the ladder guides the team."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the step and its age."""
        if facts.snapshot is None:
            return {}
        return {"guidance": guidance(facts.snapshot, facts.silent_s)}

    def build(self) -> None:
        """Show it."""
        self.html("guidance", "ladder")


def mission_line(mission: MissionInfo) -> str:
    """Return what flies and in which state."""
    return (
        f"<b>{escape(mission.scenario)}</b>"
        f'<span class="chip {mission.state}">{mission.state.value}</span>'
        f"<small>{escape(mission.id)} · {escape(mission.llm)} · gate {mission.gate.value}</small>"
    )


def mission_clock(snapshot: Json, silent_s: float) -> str:
    """Return mission time; it is marked where nobody knows whether it goes on."""
    time = clock(snapshot["time_s"])
    if not silent_s:
        return time
    return f'<span class="stale" title="Nothing was heard since">{time}</span>'


def loop_level(name: str, loop: Json) -> str:
    """Return ok, warn or alarm for one loop's lamp; idle before its first call.

    One that waits for a person is not stale, however old its last answer is; it wants a look.
    """
    if not loop["calls"]:
        return "idle"
    if _waits(loop):
        return "warn"
    # A scenario may let a model rest for longer, and a slow model rests as long as it takes.
    period_s = max(PERIODS_S[name], 1.0 / loop["rate_hz"] if loop["rate_hz"] else 0.0)
    age_s = loop["age_s"]
    if age_s is None or age_s > STALE_PERIODS * max(period_s, 1.0):
        return "alarm"
    low = loop["success_rate"] is not None and loop["success_rate"] < GOOD_SUCCESS
    return "warn" if low else "ok"


def _waits(loop: Json) -> bool:
    """Tell whether a loop waits for an approval. Recordings of earlier versions do not tell it."""
    return bool(loop.get("waits_for_person", False))


def lamps(snapshot: Json, silent_s: float = 0.0) -> str:
    """Return the three loop lamps: rate or age, and success.

    Of a planner that has been silent for `silent_s` seconds nothing is known of any loop.
    """
    if silent_s:
        return _silent_lamps(snapshot, silent_s)
    parts = []
    for name, title in LOOPS:
        loop = snapshot["loops"].get(name)
        if loop is None:
            continue
        level = loop_level(name, loop)
        if name == "optimizer":
            rate = loop["rate_hz"]
            figure = "–" if rate is None else f"{rate:.1f} Hz"
        else:
            figure = "no answer yet" if loop["age_s"] is None else f"{loop['age_s']:.0f} s ago"
        if _waits(loop):
            figure = "waits for a person"
        success = loop["success_rate"]
        share = "" if success is None else f" · {100 * success:.0f} %"
        words = "waits for a person" if _waits(loop) else LEVEL_WORDS[level]
        hint = f"{title}: {words}; {loop['calls']} calls, {loop['missed']} missed"
        # Recordings of earlier versions do not tell it.
        if (adopted := loop.get("adopted_rate")) is not None:
            hint += f", {100 * adopted:.0f} % of the answers went into force"
        parts.append(
            f'<div class="lamp {level}" title="{escape(hint)}">'
            f'<i aria-label="{words}"></i><b>{title}</b><span>{figure}{share}</span></div>'
        )
    return "".join(parts)


def _silent_lamps(snapshot: Json, silent_s: float) -> str:
    parts = []
    for name, title in LOOPS:
        if name not in snapshot["loops"]:
            continue
        level, figure = "idle", "not known"
        if name == "optimizer":
            level, figure = "alarm", f"silent for {silent_s:.0f} s"
        parts.append(
            f'<div class="lamp {level}" title="{title}: the planner says nothing; vehicles hold by'
            f' themselves"><i aria-label="silent"></i><b>{title}</b><span>{figure}</span></div>'
        )
    return "".join(parts)


def guidance(snapshot: Json, silent_s: float = 0.0) -> str:
    """Return which step of the ladder guides the team, and how old that is.

    `silent_s` is for how long the planner has told nothing new.
    """
    level = snapshot["guidance"]["level"]
    age = snapshot["guidance"]["age_s"]
    tone = {"model": "ok", "last_valid": "warn", "solver": "warn"}.get(level, "alarm")
    since = "" if age is None else f"{age + silent_s:.0f} s old"
    return (
        f'<div class="guidance {tone}"><b>{GUIDANCE_WORDS.get(level, escape(level))}</b>'
        f"<span>{since}</span></div>"
    )
