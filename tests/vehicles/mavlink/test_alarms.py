import pytest

from vehicles.mavlink.alarms import QUIET_S, RECENT_S, Alarm, Watch, alarm_of
from vehicles.mavlink.telemetry import StatusText, Telemetry


@pytest.mark.parametrize(
    ("severity", "words", "alarm"),
    [
        (4, "Battery 1 is low 10.42V used 1000 mAh", Alarm.BATTERY),
        (2, "Low battery, return advised", Alarm.BATTERY),
        (4, "Fence Breached", Alarm.FENCE),
        (4, "GCS Failsafe", Alarm.FAILSAFE),
        (6, "Battery is fine", None),
        (4, "PreArm: compass not healthy", None),
    ],
)
def test_texts(severity: int, words: str, alarm: Alarm | None) -> None:
    assert alarm_of(StatusText(severity, words, 0.0)) is alarm


def test_many_signs_of_one_battery_are_one_alarm() -> None:
    watch, told = Watch(0.2), Telemetry(battery=0.15)
    raised = list(watch.look(told, 0.0))
    for second in range(1, 100):
        told.battery_low = second > 10
        told.texts.append(StatusText(4, "Battery 1 is low", float(second)))
        raised += watch.look(told, float(second))
    assert [alarm for alarm, _ in raised] == [Alarm.BATTERY]


def test_an_alarm_can_be_raised_again_when_it_has_passed() -> None:
    watch, told = Watch(0.2), Telemetry(fence_breached=True)
    assert len(watch.look(told, 0.0)) == 1
    told.fence_breached = False
    assert watch.look(told, QUIET_S / 2) == ()
    told.fence_breached = True
    assert watch.look(told, QUIET_S - 1.0) == ()
    told.fence_breached = False
    assert watch.look(told, 2 * QUIET_S) == ()
    told.fence_breached = True
    assert [alarm for alarm, _ in watch.look(told, 2 * QUIET_S + 1)] == [Alarm.FENCE]


def test_alarms_do_not_hide_each_other() -> None:
    watch, told = Watch(0.2), Telemetry(battery=0.1, fence_breached=True)
    assert {alarm for alarm, _ in watch.look(told, 0.0)} == {Alarm.BATTERY, Alarm.FENCE}


def test_only_the_autopilots_own_signs_explain_its_acts() -> None:
    watch, told = Watch(0.2), Telemetry(battery=0.1)
    watch.look(told, 0.0)
    assert not watch.acts(0.0)
    told.texts.append(StatusText(4, "Battery Failsafe", 1.0))
    watch.look(told, 1.0)
    assert watch.acts(1.0 + RECENT_S)
    assert not watch.acts(1.1 + RECENT_S)
