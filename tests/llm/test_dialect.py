from dataclasses import replace

import pytest

from llm.chat import ErrorKind
from llm.dialect import AnswerFormat, Dialect
from llm.mock.app import in_process_client
from llm.mock.behaviours import Behaviour
from tests.llm.endpoints import ASKED, Endpoint, client_of, error_of, failing, ok


@pytest.mark.asyncio
async def test_the_weaker_formats_are_found_and_remembered() -> None:
    refuse = failing(400, "response_format json_schema is not supported")
    endpoint = Endpoint(refuse, refuse, ok())
    async with client_of(endpoint) as client:
        await client.complete(ASKED, 5.0)
        await client.complete(ASKED, 5.0)
    assert client.answer_format is AnswerFormat.NONE
    kinds = [body.get("response_format", {}).get("type") for body in endpoint.bodies]
    assert kinds == ["json_schema", "json_object", None, None]


@pytest.mark.asyncio
async def test_a_request_wrong_in_itself_teaches_nothing_about_formats() -> None:
    endpoint = Endpoint(failing(400, "context too long"))
    async with client_of(endpoint) as client:
        error = await error_of(client)
        assert error.kind is ErrorKind.REJECTED
        assert client.answer_format is AnswerFormat.JSON_SCHEMA
    assert len(endpoint.requests) == 3


@pytest.mark.asyncio
async def test_other_fields_of_the_dialect_are_found_too() -> None:
    endpoint = Endpoint(
        failing(400, "Unsupported parameter: use max_completion_tokens instead"),
        failing(400, "Unsupported value: temperature does not support 0"),
        ok(),
    )
    async with client_of(endpoint) as client:
        await client.complete(ASKED, 5.0)
    last = endpoint.bodies[-1]
    assert last["max_completion_tokens"] == 50
    assert "max_tokens" not in last
    assert "temperature" not in last
    assert last["response_format"]["type"] == "json_schema"


def test_without_a_schema_no_format_is_sent() -> None:
    body = Dialect().body("m", replace(ASKED, schema=None))
    assert "response_format" not in body


@pytest.mark.parametrize(
    ("formats", "found"),
    [
        (("json_schema", "json_object"), AnswerFormat.JSON_SCHEMA),
        (("json_object",), AnswerFormat.JSON_OBJECT),
        ((), AnswerFormat.NONE),
    ],
)
@pytest.mark.asyncio
async def test_the_mocks_formats_are_detected(
    formats: tuple[str, ...], found: AnswerFormat
) -> None:
    async with in_process_client(Behaviour(formats=formats)) as client:
        await client.complete(ASKED, 5.0)
        assert client.answer_format is found
