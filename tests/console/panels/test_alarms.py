import re

from console.panels import alarms
from server.api.alarm_models import Acknowledgement, Alarm
from tests.console.reading import EVIL, words

ACTIVE = Alarm(
    id="link-31",
    number=1,
    title="Robot 31 is cut off",
    severity="warning",
    robot=31,
    target=None,
    text="Robot 31 is silent but alive.",
    count=3,
    rate_per_min=3.0,
    since_s=63.2,
    last_s=70.0,
    over_s=None,
    active=True,
    acknowledged=None,
)


def variant(**changes: object) -> Alarm:
    return ACTIVE.model_copy(update=changes)


KNOWN = variant(id="link-21", acknowledged=Acknowledgement(by="ada", time_s=71.0))
OVER = variant(id="target-122", active=False, over_s=80.0)
WORST = variant(id="journal", severity="alarm", robot=None, last_s=1.0)


def test_a_row_tells_how_often_since_when_and_who_knows() -> None:
    text = words(alarms.alarm_list([ACTIVE]))
    assert text == (
        "Robot 31 is cut off Acknowledge 3 × · since 1:03.2 · 3 per minute D31"
        " Robot 31 is silent but alive."
    )
    assert "ada, 1:11.0" in words(alarms.alarm_list([KNOWN]))
    assert "over since 1:20.0" in words(alarms.alarm_list([OVER]))


def test_what_wants_a_look_comes_first() -> None:
    html = alarms.alarm_list([OVER, KNOWN, ACTIVE, WORST])
    assert re.findall('class="alarm ([a-z]+)"', html) == ["serious", "warning", "known", "over"]
    assert re.findall('data-tap="([^"]+)"', html) == [
        "ack:journal",
        "ack:link-31",
        "ack:target-122",
    ]


def test_the_lamp_has_colour_only_for_what_stands_and_nobody_knows() -> None:
    def tone(*known: Alarm) -> str:
        found: list[str] = re.findall('class="lamp ([a-z]+)"', alarms.lamp(list(known)))
        return found[0]

    assert [tone(), tone(KNOWN, OVER), tone(KNOWN, ACTIVE), tone(ACTIVE, WORST)] == [
        "calm",
        "calm",
        "warn",
        "alarm",
    ]
    assert words(alarms.lamp([ACTIVE, KNOWN, OVER])) == "Alarms 1 new"
    assert words(alarms.lamp([KNOWN, OVER])) == "Alarms 1 known"
    assert words(alarms.lamp([OVER])) == "Alarms none"


def test_what_vehicles_say_is_never_run() -> None:
    known = Acknowledgement(by=EVIL, time_s=1.0)
    html = alarms.alarm_list([variant(id=EVIL, title=EVIL, text=EVIL), variant(acknowledged=known)])
    assert "<script>" not in html
    assert html.count("&lt;script&gt;") == 5
