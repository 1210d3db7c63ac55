"""Keeping watch over alarms: what REST and the console do with them."""

from collections.abc import Callable, Iterable
from http import HTTPStatus

from server.api.alarm_models import Alarm
from server.api.errors import ServiceError
from server.api.record import MissionRecord
from server.encoding import EventKind, Severity
from server.journal.journal import JournalStatus


class Watch:
    """Reads alarms and acknowledges them. The records own them."""

    def __init__(self, record_of: Callable[[str], MissionRecord]) -> None:
        self._record_of = record_of

    def alarms(self, mission_id: str) -> list[Alarm]:
        """Return a mission's alarms, the first raised first. Raises ServiceError 404."""
        return self._record_of(mission_id).alarms.all()

    def acknowledge(self, mission_id: str, alarm_id: str, author: str) -> Alarm:
        """Take note of an alarm in somebody's name; the first name stays.

        Raises ServiceError 404.
        """
        record = self._record_of(mission_id)
        alarm = record.alarms.find(alarm_id)
        if alarm is not None and alarm.acknowledged is None:
            record.acknowledge(alarm, author)
            alarm = record.alarms.find(alarm_id)
        if alarm is None:
            raise ServiceError(
                "alarm_unknown",
                f"There is no alarm {alarm_id} in mission {mission_id}.",
                HTTPStatus.NOT_FOUND,
            )
        return alarm


def tell_of_journal(records: Iterable[MissionRecord], status: JournalStatus) -> None:
    """Tell the live missions that the journal went away or came back."""
    severity, words = Severity.INFO, "The journal works again; comments are taken."
    if not status.available:
        severity = Severity.ALARM
        words = f"The journal is not available: no comments are taken. {status.reason}"
    for record in records:
        if record.live:
            record.report(EventKind.ALARM, severity, words, "journal")


def tell_of_clock(records: Iterable[MissionRecord], words: str) -> None:
    """Tell the live missions that this machine's wall clock has jumped."""
    for record in records:
        if record.live:
            record.report(EventKind.ALARM, Severity.WARNING, words, "clock")
