"""The three silences, in virtual time."""

import pytest

from solver.observations import Link
from vehicles.link_monitor import LinkMonitor, LinkSettings, Standing

SETTINGS = LinkSettings()


def monitor() -> LinkMonitor:
    return LinkMonitor((21, 26), SETTINGS, now_s=0.0)


def links(watch: LinkMonitor, now_s: float) -> dict[int, Link]:
    return {change.robot_id: change.link for change in watch.changes(now_s)}


def test_nothing_is_said_before_a_robot_is_heard_or_late() -> None:
    watch = monitor()
    assert links(watch, 0.4) == {}
    watch.heard(21, "a", 1.0)
    assert links(watch, 1.0) == {21: Link.CONNECTED}
    assert links(watch, 1.4) == {}, "each change is told once"
    watch.heard(21, "a", 3.1)
    assert links(watch, 3.1) == {26: Link.LOST}
    assert watch.link(26) is Link.LOST
    watch.heard(26, "b", 5.0)
    assert links(watch, 5.0) == {21: Link.JAMMED, 26: Link.CONNECTED}


def test_silent_with_a_token_is_jammed_and_comes_back() -> None:
    watch = monitor()
    watch.appeared(21)
    watch.heard(21, "a", 0.0)
    assert links(watch, 0.5) == {21: Link.CONNECTED}
    assert links(watch, 0.51) == {21: Link.JAMMED}
    assert 21 not in links(watch, 60.0)
    watch.heard(21, "a", 60.1)
    assert links(watch, 60.1) == {21: Link.CONNECTED}


def test_a_token_is_not_believed_for_ever() -> None:
    watch = monitor()
    watch.appeared(21)
    watch.heard(21, "a", 0.0)
    links(watch, 1.0)
    assert links(watch, SETTINGS.jam_limit_s + 0.1)[21] is Link.LOST


def test_silent_without_its_token_is_lost_at_once() -> None:
    watch = monitor()
    watch.appeared(21)
    watch.heard(21, "a", 1.0)
    watch.disappeared(21)
    assert links(watch, 1.4) == {21: Link.CONNECTED}, "still heard"
    assert links(watch, 1.51) == {21: Link.LOST}


def test_a_jammed_robot_whose_token_goes_is_lost() -> None:
    watch = monitor()
    watch.appeared(21)
    watch.heard(21, "a", 0.0)
    assert links(watch, 1.0)[21] is Link.JAMMED
    watch.disappeared(21)
    assert links(watch, 1.1)[21] is Link.LOST


def test_a_robot_that_has_no_token_is_given_time() -> None:
    watch = monitor()
    watch.heard(21, "a", 0.0)
    assert links(watch, 0.1)[21] is Link.CONNECTED
    assert links(watch, 1.0)[21] is Link.JAMMED
    assert links(watch, SETTINGS.lost_after_s + 0.1)[21] is Link.LOST


def test_a_robot_that_is_announced_but_never_speaks_is_jammed() -> None:
    watch = monitor()
    watch.appeared(21)
    assert links(watch, 1.0) == {21: Link.JAMMED}


def test_a_second_run_is_refused_while_the_first_speaks() -> None:
    watch = monitor()
    assert watch.heard(21, "a", 0.0) is Standing.KNOWN
    assert watch.heard(21, "b", 0.9) is Standing.DUPLICATE
    assert watch.heard(21, "a", 0.95) is Standing.KNOWN
    assert watch.heard(21, "b", 1.9) is Standing.DUPLICATE, "its own words do not help it"
    assert watch.heard(21, "b", 1.95) is Standing.KNOWN, "the first is silent: a restart"
    assert watch.heard(21, "a", 2.0) is Standing.DUPLICATE


def test_the_next_run_is_welcome_at_once_when_the_token_has_gone() -> None:
    watch = monitor()
    watch.appeared(21)
    watch.heard(21, "a", 0.0)
    watch.disappeared(21)
    assert watch.heard(21, "b", 0.1) is Standing.KNOWN


@pytest.mark.parametrize("stranger", [0, 99])
def test_strangers_are_unknown_and_make_no_link(stranger: int) -> None:
    watch = monitor()
    watch.appeared(stranger)
    watch.disappeared(stranger)
    assert watch.heard(stranger, "x", 0.0) is Standing.UNKNOWN
    assert watch.link(stranger) is None
    assert stranger not in links(watch, 10.0)
