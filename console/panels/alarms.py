"""Alarms: grouped by cause, counted, acknowledged; and their lamp in the top bar."""

import re

from console.board import Facts
from console.panel import Panel
from console.render import clock, escape
from server.api.alarm_models import ALARM_ID, Alarm
from server.api.service import MissionService

SHOWN = 60


class AlarmsPanel(Panel):
    """What stands and is not acknowledged first, then what stands, then what is over."""

    badge = "alarms_badge"
    styles = ("alarms.css",)

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the list and how many want to be looked at."""
        alarms = facts.service.watch.alarms(facts.mission.id)
        new = sum(wants_a_look(alarm) for alarm in alarms)
        return {"alarms": alarm_list(alarms), "alarms_badge": str(new) if new else ""}

    def build(self) -> None:
        """Show it."""
        shown = self.html("alarms", "scroll alarms").props("data-id=alarms")
        self.desk.taps(shown, self._acknowledge)

    async def _acknowledge(self, tapped: str) -> None:
        verb, _, alarm = tapped.partition(":")
        if verb != "ack" or not re.fullmatch(ALARM_ID, alarm):
            return

        async def acknowledged(service: MissionService, mission: str, author: str) -> Alarm:
            return service.watch.acknowledge(mission, alarm, author)

        await self.desk.act(acknowledged)


class AlarmLampPanel(Panel):
    """Coloured only while something stands that nobody has taken note of."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the lamp."""
        return {"alarm_lamp": lamp(facts.service.watch.alarms(facts.mission.id))}

    def build(self) -> None:
        """Show it."""
        self.html("alarm_lamp", "alarm-lamp")


def wants_a_look(alarm: Alarm) -> bool:
    """Tell whether an alarm stands and nobody has taken note of it."""
    return alarm.active and alarm.acknowledged is None


def lamp(alarms: list[Alarm]) -> str:
    """Return the lamp in the top bar; tapped, it opens the list."""
    new = [alarm for alarm in alarms if wants_a_look(alarm)]
    active = sum(alarm.active for alarm in alarms)
    worst = "alarm" if any(a.severity == "alarm" for a in new) else "warn"
    tone = worst if new else "calm"
    words = f"{len(new)} new" if new else f"{active} known" if active else "none"
    return (
        f'<button type="button" class="lamp {tone}" data-reveal="alarms"'
        f' title="Open the list of alarms"><i></i><b>Alarms</b>'
        f"<span>{words}</span></button>"
    )


def alarm_list(alarms: list[Alarm]) -> str:
    """Return the alarms, what wants to be looked at first, the newest first within."""

    def rank(alarm: Alarm) -> tuple[bool, bool, bool, float]:
        known = alarm.acknowledged is not None
        return (not alarm.active, known, alarm.severity != "alarm", -alarm.last_s)

    rows = [_row(alarm) for alarm in sorted(alarms, key=rank)[:SHOWN]]
    return "".join(rows) or '<p class="empty">Nothing has gone wrong so far.</p>'


def _row(alarm: Alarm) -> str:
    if alarm.over_s is None:
        state = f"since {clock(alarm.since_s)}"
    else:
        state = f"over since {clock(alarm.over_s)}"
    name = escape(alarm.id)
    known = alarm.acknowledged
    if known is None:
        end = (
            f'<button type="button" class="plain" data-tap="ack:{name}"'
            f' aria-label="Acknowledge: {escape(alarm.title)}">Acknowledge</button>'
        )
    else:
        end = f"<small>{escape(known.by)}, {clock(known.time_s)}</small>"
    standing = "serious" if alarm.severity == "alarm" else "warning"
    tone = "over" if not alarm.active else ("known" if known is not None else standing)
    rate = f" · {alarm.rate_per_min:.0f} per minute" if alarm.rate_per_min >= 2.0 else ""
    robot = (
        ""
        if alarm.robot is None
        else f' <button type="button" class="link" data-reveal="robot-{alarm.robot}">'
        f"D{alarm.robot}</button>"
    )
    return (
        f'<article class="alarm {tone}"><i></i><b>{escape(alarm.title)}</b>'
        f'<div class="end">{end}</div>'
        f"<span>{alarm.count} × · {state}{rate}{robot}</span>"
        f"<p>{escape(alarm.text)}</p></article>"
    )
