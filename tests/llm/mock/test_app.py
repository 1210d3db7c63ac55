import json
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import httpx
import pytest
import uvicorn

from llm.chat import ErrorKind, ModelError
from llm.client import ChatClient, ModelProfile
from llm.consultation import Accepted, GivenUp
from llm.mock.app import BEHAVIOUR_HEADER, MODEL, create_app
from llm.mock.behaviours import Behaviour, Mode
from llm.prompts import AnswerForm, Loop, PromptView, task_request
from llm.tokens import estimate_tokens
from tests.llm.builders import LIMITS, ablation, hardware
from tests.llm.mock.asking import consulted

VIEW = PromptView(hardware().snapshot(), LIMITS)


def http(behaviour: Behaviour | None = None) -> httpx.AsyncClient:
    app = create_app(behaviour or Behaviour())
    transport = httpx.ASGITransport(app=app)
    return httpx.AsyncClient(transport=transport, base_url="http://mock.test")


def body(**changes: object) -> dict[str, object]:
    request = task_request(VIEW)
    messages = [{"role": m.role, "content": m.content} for m in request.messages]
    return {"model": MODEL, "messages": messages, **changes}


@pytest.mark.asyncio
async def test_models_are_listed() -> None:
    async with http() as client:
        answer = await client.get("/v1/models")
    assert [model["id"] for model in answer.json()["data"]] == [MODEL]


@pytest.mark.asyncio
async def test_a_completion_has_the_usual_shape() -> None:
    async with http() as client:
        answer = (await client.post("/v1/chat/completions", json=body())).json()
    choice = answer["choices"][0]
    assert choice["finish_reason"] == "stop"
    assert set(json.loads(choice["message"]["content"])["assignment"]) == {"21", "26"}
    usage = answer["usage"]
    assert usage["total_tokens"] == usage["prompt_tokens"] + usage["completion_tokens"]
    assert usage["completion_tokens"] == estimate_tokens(choice["message"]["content"])


@pytest.mark.asyncio
async def test_the_token_limit_cuts_an_answer_off() -> None:
    async with http() as client:
        answer = (await client.post("/v1/chat/completions", json=body(max_tokens=10))).json()
    assert answer["choices"][0]["finish_reason"] == "length"
    assert answer["usage"]["completion_tokens"] <= 10


@pytest.mark.parametrize(
    ("changes", "status"),
    [
        ({"messages": []}, 422),
        ({"messages": "x"}, 422),
        ({"stream": True}, 400),
        ({"response_format": {"type": "xml"}}, 400),
        ({"max_tokens": 0}, 422),
    ],
)
@pytest.mark.asyncio
async def test_bad_requests_are_refused(changes: dict[str, object], status: int) -> None:
    async with http() as client:
        answer = await client.post("/v1/chat/completions", json=body(**changes))
    assert answer.status_code == status


@pytest.mark.asyncio
async def test_a_prompt_of_somebody_else_is_not_understood() -> None:
    messages = [{"role": "user", "content": "Tell me a joke."}]
    async with http() as client:
        answer = await client.post("/v1/chat/completions", json=body(messages=messages))
    assert "do not understand" in answer.json()["choices"][0]["message"]["content"]


@pytest.mark.asyncio
async def test_the_behaviour_can_be_changed_while_it_runs() -> None:
    async with http() as client:
        told = await client.put("/mock/behaviour", json={"mode": "fail_500", "times": 1})
        assert told.json()["mode"] == "fail_500"
        first = await client.post("/v1/chat/completions", json=body())
        second = await client.post("/v1/chat/completions", json=body())
        unknown = await client.put("/mock/behaviour", json={"mode": "polite"})
    assert (first.status_code, second.status_code, unknown.status_code) == (500, 200, 422)
    assert first.json()["error"]["message"] == "told to fail"


@pytest.mark.asyncio
async def test_one_request_can_ask_to_be_treated_badly() -> None:
    async with http() as client:
        headers = {BEHAVIOUR_HEADER: "fail_429"}
        bad = await client.post("/v1/chat/completions", json=body(), headers=headers)
        good = await client.post("/v1/chat/completions", json=body())
        headers = {BEHAVIOUR_HEADER: "polite"}
        unknown = await client.post("/v1/chat/completions", json=body(), headers=headers)
    assert (bad.status_code, good.status_code, unknown.status_code) == (429, 200, 400)


WRONG = [
    Mode.GARBAGE,
    Mode.EMPTY,
    Mode.REFUSE,
    Mode.OVER_CAPACITY,
    Mode.UNCOVERED,
    Mode.UNKNOWN_IDS,
    Mode.NAN,
    Mode.WRONG_LENGTH,
    Mode.OUT_OF_BOUNDS,
]


@pytest.mark.parametrize("form", list(AnswerForm))
@pytest.mark.parametrize("loop", list(Loop))
@pytest.mark.parametrize("mode", WRONG)
@pytest.mark.asyncio
async def test_wrong_answers_are_refused_and_mended_by_a_retry(
    mode: Mode, loop: Loop, form: AnswerForm
) -> None:
    view = PromptView(ablation().snapshot(), LIMITS, form=form)
    call, outcome = await consulted(view, loop, Behaviour(mode, times=1))
    assert isinstance(outcome, Accepted)
    assert (call.stats.tries, call.stats.valid_first) == (2, False)
    assert call.attempts[0].reasons


@pytest.mark.parametrize("loop", list(Loop))
@pytest.mark.parametrize("mode", WRONG)
@pytest.mark.asyncio
async def test_wrong_answers_for_ever_are_given_up(mode: Mode, loop: Loop) -> None:
    view = PromptView(ablation().snapshot(), LIMITS)
    call, outcome = await consulted(view, loop, Behaviour(mode))
    assert isinstance(outcome, GivenUp)
    assert call.stats.tries == call.max_tries
    assert outcome.reasons


def test_the_wrong_modes_are_all_of_them() -> None:
    of_transport = {
        Mode.SLOW,
        Mode.FAIL_429,
        Mode.FAIL_500,
        Mode.STALL,
        Mode.HUGE,
        Mode.NOT_JSON,
    }
    assert set(Mode) == {*WRONG, *of_transport, Mode.SOUND, Mode.OBEY}


@contextmanager
def served(behaviour: Behaviour) -> Iterator[str]:
    """Serve the mock over TCP in a thread."""
    config = uvicorn.Config(create_app(behaviour), host="127.0.0.1", port=0, log_level="warning")
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            assert thread.is_alive()
            time.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        yield f"http://127.0.0.1:{port}/v1"
    finally:
        server.should_exit = True
        thread.join(10.0)


@pytest.mark.sockets
@pytest.mark.asyncio
async def test_over_tcp_it_is_the_same_model() -> None:
    request = task_request(VIEW)
    with served(Behaviour()) as url:
        async with ChatClient(ModelProfile(url, MODEL)) as client:
            reply = await client.complete(request, 10.0)
    _, outcome = await consulted(VIEW, Loop.TASK)
    assert isinstance(outcome, Accepted)
    rows = json.loads(reply.text)["assignment"]
    assert {int(k): tuple(v) for k, v in rows.items()} == dict(outcome.proposal.assignment or ())


@pytest.mark.sockets
@pytest.mark.asyncio
async def test_over_tcp_a_stalled_body_meets_the_time_out() -> None:
    with served(Behaviour(Mode.STALL, delay_s=0.6)) as url:
        async with ChatClient(ModelProfile(url, MODEL)) as client:
            with pytest.raises(ModelError) as caught:
                await client.complete(task_request(VIEW), 0.3)
    assert caught.value.kind is ErrorKind.TIMEOUT


def test_nothing_but_the_prompt_goes_in() -> None:
    """The mock's rules know neither the vocabulary nor the prompt builder."""
    from pathlib import Path

    import llm.mock

    folder = Path(llm.mock.__path__[0])
    for path in folder.glob("*.py"):
        imports = re.findall(r"^(?:from|import) ((?:llm|solver)[\w.]*)", path.read_text(), re.M)
        allowed = {"llm.tokens", "llm.client"} if path.name == "app.py" else set()
        foreign = {name for name in imports if not name.startswith("llm.mock")}
        assert foreign <= allowed, path.name
