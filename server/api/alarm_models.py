"""Alarms as told over HTTP."""

from typing import Final, Literal

from pydantic import Field

from server.api.models import Answer

ALARM_ID: Final = r"^[A-Za-z0-9_.-]{1,64}$"


class Acknowledgement(Answer):
    """Who has taken note of an alarm, and when."""

    by: str = Field(description="As in the journal.", examples=["operator"])
    time_s: float = Field(description="Mission time.")


class Alarm(Answer):
    """One cause of trouble: what happens again for the same cause counts up the same alarm."""

    id: str = Field(
        description="Made of the cause, so that it stays the same after a restart.",
        examples=["link-21"],
    )
    number: int = Field(description="In the order of being raised for the first time, from 1.")
    title: str = Field(description="In plain words.", examples=["Robot 21 is cut off"])
    severity: Literal["warning", "alarm"]
    robot: int | None = Field(description="The robot it is about, if it is about one.")
    target: int | None = Field(description="The target, likewise.")
    text: str = Field(description="The newest event behind it.")
    count: int = Field(description="Events so far.")
    rate_per_min: float = Field(description="Events in the last minute of mission time.")
    since_s: float = Field(description="Mission time at which it was raised this time.")
    last_s: float = Field(description="Mission time of the newest event.")
    over_s: float | None = Field(description="Mission time of its end; null while it stands.")
    active: bool = Field(description="Whether it stands.")
    acknowledged: Acknowledgement | None = Field(
        description="Null again when it is raised anew, or becomes worse."
    )


class AlarmPage(Answer):
    """Alarms in the order of their numbers."""

    alarms: list[Alarm]
    next_after: int = Field(description="Pass it as `after` to get those with higher numbers.")
