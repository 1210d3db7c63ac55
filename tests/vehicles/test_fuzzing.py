"""A short run of the bus's fuzzer, and proof that it finds what is planted."""

import math
import random

import pytest
from pydantic import BaseModel

from tests.vehicles import fuzzing
from tests.vehicles.fuzzing import Found, check, fuzz
from vehicles import messages as wire
from vehicles.agent import VehicleAgent


@pytest.fixture(autouse=True)
def quiet(caplog: pytest.LogCaptureFixture) -> None:
    """Every refusal is logged; nobody reads thousands."""
    caplog.set_level("CRITICAL", logger="vehicles")


@pytest.mark.asyncio
async def test_nothing_escapes() -> None:
    figures = await fuzz(4_000, seed=1)
    assert 800 < figures.accepted < 3_200
    assert figures.growth_blocks < 2_000


@pytest.mark.asyncio
async def test_a_planted_root_of_a_negative_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    take = VehicleAgent._take_setpoint

    def faulty(self: VehicleAgent, message: wire.Setpoint, now_s: float) -> None:
        assert math.sqrt(min(message.velocity)) >= 0.0
        take(self, message, now_s)

    monkeypatch.setattr(VehicleAgent, "_take_setpoint", faulty)
    with pytest.raises(Found, match=r"ValueError.*seed 2, payload \d+ on falconer/red"):
        await fuzz(20_000, seed=2)


@pytest.mark.asyncio
async def test_a_receiver_that_trusts_its_json_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    def trusting(kind: type[wire.Message], payload: bytes) -> wire.Message:
        return kind.model_validate_json(payload)

    monkeypatch.setattr(wire, "decode", trusting)
    with pytest.raises(Found, match="ValidationError"):
        await fuzz(1_000, seed=1)


def test_a_number_that_is_not_finite_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    class Loose(BaseModel):
        number: float

    monkeypatch.setattr(wire, "decode", lambda kind, payload: kind.model_validate_json(payload))
    with pytest.raises(Found, match="not finite"):
        check(Loose, b'{"number": Infinity}')  # type: ignore[arg-type]


def test_payloads_are_what_they_claim_to_be() -> None:
    source = fuzzing.said(random.Random(3))
    places = [next(source) for _ in range(3_000)]
    assert {kind for _, kind, _ in places} >= set(fuzzing.OF_TOPIC.values())
    assert any(len(payload) > wire.MAX_PAYLOAD for _, _, payload in places)
    sound = sum(check(kind, payload) for _, kind, payload in places)
    assert 600 < sound < 2_400
