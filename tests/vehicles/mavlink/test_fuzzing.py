"""A short run of the fuzzer, and proof that it finds what is planted."""

import random
from typing import Any

import pytest

from solver.setpoints import Setpoint
from tests.vehicles.mavlink import fuzzing
from tests.vehicles.mavlink.fuzzing import Found, frames, fuzz, noise
from vehicles.mavlink.protocol import mavlink
from vehicles.mavlink.session import Session


def test_frames_with_a_correct_checksum() -> None:
    figures = fuzz(fuzzing.session(), frames, 20_000, seed=1)
    assert figures.accepted > 10_000
    assert figures.growth_blocks < 2_000


def test_noise() -> None:
    figures = fuzz(fuzzing.session(), noise, 20_000, seed=2)
    assert figures.accepted == 0
    assert figures.growth_blocks < 2_000


def plant(monkeypatch: pytest.MonkeyPatch, bug: Any) -> Session:
    target = fuzzing.session()
    receive = target.telemetry.__class__.receive

    def faulty(self: Any, message: Any, now_s: float) -> None:
        bug(target, message)
        receive(self, message, now_s)

    monkeypatch.setattr(target.telemetry.__class__, "receive", faulty)
    return target


def test_a_planted_division_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def divide(target: Session, message: Any) -> None:
        if message.get_type() == "GLOBAL_POSITION_INT":
            target.telemetry.battery = 1.0 / message.vx

    with pytest.raises(Found, match=r"ZeroDivisionError.*seed 1, datagram"):
        fuzz(plant(monkeypatch, divide), frames, 50_000, seed=1)


def test_a_planted_setpoint_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """A bug that takes a text of the vehicle for a word of the planner."""

    def obey(target: Session, message: Any) -> None:
        if message.get_type() == "STATUSTEXT" and target.telemetry.position_s is not None:
            place = target.telemetry.position[:2]
            target.follow(Setpoint(7, (1.0, 0.0), place, 2.0, 0.5), target.telemetry.position_s)

    with pytest.raises(
        Found, match=r"(SET_POSITION_TARGET_LOCAL_NED|HEARTBEAT) sent; seed 1, datagram"
    ):
        fuzz(plant(monkeypatch, obey), frames, 50_000, seed=1)


def test_a_missing_check_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the check of plausible numbers an impossible latitude gets as far as geodesy."""

    def believe(message: Any) -> bool:
        return True

    monkeypatch.setattr("vehicles.mavlink.session.plausible", believe)

    def check(target: Session, message: Any) -> None:
        if message.get_type() == "GPS_GLOBAL_ORIGIN":
            assert abs(message.latitude) <= 900_000_000

    with pytest.raises(Found, match="AssertionError"):
        fuzz(plant(monkeypatch, check), frames, 20_000, seed=1)


def test_frames_are_what_they_claim_to_be() -> None:
    source = frames(random.Random(3))
    parser = mavlink.MAVLink(None, 1, 1)
    parser.robust_parsing = True
    kinds = [m.get_type() for _ in range(2000) for m in parser.parse_buffer(next(source)) or []]
    assert kinds.count("BAD_DATA") < 0.1 * len(kinds)
    assert len(set(kinds)) > 100
