"""How one endpoint wants the same request said. Detected by trying, remembered by use."""

import re
from dataclasses import dataclass, replace
from enum import StrEnum
from http import HTTPStatus
from typing import Any

from llm.chat import ChatRequest


class AnswerFormat(StrEnum):
    """How strictly the endpoint can be held to a schema."""

    JSON_SCHEMA = "json_schema"
    JSON_OBJECT = "json_object"
    NONE = "none"


_WEAKER = {
    AnswerFormat.JSON_SCHEMA: AnswerFormat.JSON_OBJECT,
    AnswerFormat.JSON_OBJECT: AnswerFormat.NONE,
}
_REFUSING = frozenset(
    {
        HTTPStatus.BAD_REQUEST,
        HTTPStatus.NOT_FOUND,
        HTTPStatus.UNPROCESSABLE_ENTITY,
        HTTPStatus.NOT_IMPLEMENTED,
    }
)
_ABOUT_FORMAT = re.compile(r"response_format|json_schema|json_object|schema|grammar", re.I)


@dataclass(frozen=True, slots=True)
class Dialect:
    """Which fields an endpoint understands."""

    answer_format: AnswerFormat = AnswerFormat.JSON_SCHEMA
    token_field: str = "max_tokens"
    sends_temperature: bool = True

    def body(self, model: str, request: ChatRequest) -> dict[str, Any]:
        """Return the JSON body of a chat completion request."""
        body: dict[str, Any] = {
            "model": model,
            "messages": [{"role": m.role, "content": m.content} for m in request.messages],
            "stream": False,
            self.token_field: request.max_tokens,
        }
        if self.sends_temperature:
            body["temperature"] = 0
        if request.schema is not None:
            body.update(self._response_format(request))
        return body

    def _response_format(self, request: ChatRequest) -> dict[str, Any]:
        match self.answer_format:
            case AnswerFormat.JSON_SCHEMA:
                named = {
                    "name": request.schema_name,
                    "strict": True,
                    "schema": dict(request.schema or {}),
                }
                return {"response_format": {"type": "json_schema", "json_schema": named}}
            case AnswerFormat.JSON_OBJECT:
                return {"response_format": {"type": "json_object"}}
            case AnswerFormat.NONE:
                return {}

    def after_refusal(self, status: int, words: str, request: ChatRequest) -> "Dialect | None":
        """Return a simpler dialect worth trying after a refusal, None where there is none."""
        about_format = bool(_ABOUT_FORMAT.search(words))
        if status not in _REFUSING and not (status >= 500 and about_format):
            return None
        if self.token_field == "max_tokens" and "max_completion_tokens" in words:
            return replace(self, token_field="max_completion_tokens")
        if self.sends_temperature and "temperature" in words and not about_format:
            return replace(self, sends_temperature=False)
        if request.schema is None or self.answer_format is AnswerFormat.NONE:
            return None
        if status == HTTPStatus.NOT_FOUND and not about_format:
            return None
        return replace(self, answer_format=_WEAKER[self.answer_format])
