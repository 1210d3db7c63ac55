import pytest

from llm.breaker import Breaker
from llm.chat import ErrorKind
from tests.llm.endpoints import ASKED, Endpoint, client_of, error_of, failing, ok


@pytest.mark.asyncio
async def test_an_endpoint_that_keeps_failing_is_left_alone() -> None:
    now = 0.0
    breaker = Breaker(threshold=2, cool_down_s=30.0, clock=lambda: now)
    endpoint = Endpoint(failing(500))
    client = client_of(endpoint, attempts=1)
    client.breaker = breaker
    async with client:
        assert (await error_of(client)).kind is ErrorKind.SERVER
        assert (await error_of(client)).kind is ErrorKind.SERVER
        error = await error_of(client)
        assert error.kind is ErrorKind.CIRCUIT_OPEN
        assert error.retry_after_s == pytest.approx(30.0)
        assert len(endpoint.requests) == 2
        now = 31.0
        assert (await error_of(client)).kind is ErrorKind.SERVER, "one probe"
        assert (await error_of(client)).kind is ErrorKind.CIRCUIT_OPEN
        now = 62.0
        endpoint.answers = [ok()]
        await client.complete(ASKED, 5.0)
        await client.complete(ASKED, 5.0)


@pytest.mark.asyncio
async def test_a_request_the_endpoint_dislikes_does_not_open_the_circuit() -> None:
    client = client_of(Endpoint(failing(404)))
    client.breaker = Breaker(threshold=1)
    async with client:
        assert (await error_of(client)).kind is ErrorKind.REJECTED
        assert (await error_of(client)).kind is ErrorKind.REJECTED
