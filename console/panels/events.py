"""What has happened, in plain words."""

from collections.abc import Iterable

from console.board import Facts
from console.panel import Panel
from console.render import Json, clock, escape

EVENTS_SHOWN = 60


class EventsPanel(Panel):
    """The newest events."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the list."""
        recent = facts.service.recent_events(facts.mission.id, EVENTS_SHOWN)
        return {"events": events(recent)}

    def build(self) -> None:
        """Show it."""
        self.html("events", "scroll events")


def events(recent: Iterable[Json]) -> str:
    """Return the last events, newest first."""
    rows = [
        f'<li class="{escape(event["severity"])}"><time>{clock(event["time_s"])}</time>'
        f"<span>{escape(event['text'])}</span></li>"
        for event in reversed(list(recent))
    ]
    return f"<ol>{''.join(rows)}</ol>" if rows else '<p class="empty">No events yet.</p>'
