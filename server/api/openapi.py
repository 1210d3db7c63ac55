"""The OpenAPI document: what holds for every route is added here, once."""

import re
from typing import Any

from fastapi import FastAPI

from server.api.models import ErrorAnswer

_METHODS = frozenset({"get", "put", "post", "delete", "patch", "head", "options"})
_OPEN = frozenset({("/session", "post")})
"""Asked without a login: it is the login."""

_ALWAYS = {
    "401": "Nobody we know.",
    "403": "Not with this role, or not from this page.",
    "421": "By a foreign name.",
    "429": "Too often: Retry-After says when to ask again.",
}
_WITH_BODY = {
    "400": "The body cannot be read.",
    "413": "The body is too long.",
    "422": "The body does not fit.",
}
_SCHEMES = {
    "token": {
        "type": "http",
        "scheme": "bearer",
        "description": "A viewer's, operator's or admin's token.",
    }
}


def describe(api: FastAPI) -> None:
    """Let an application's document tell what every route may answer and asks for."""
    made = api.openapi

    def openapi() -> dict[str, Any]:
        if api.openapi_schema is None:
            api.openapi_schema = _completed(made())
        return api.openapi_schema

    api.openapi = openapi  # type: ignore[method-assign]


def allowed_methods(api: FastAPI, path: str) -> list[str]:
    """Return the methods that an application knows for a path below it."""
    found: set[str] = set()
    for template, operations in api.openapi()["paths"].items():
        if re.fullmatch(re.sub(r"\{\w+\}", r"[^/]+", template), path):
            found.update(method.upper() for method in operations if method in _METHODS)
    return sorted(found)


def _completed(document: dict[str, Any]) -> dict[str, Any]:
    components = document.setdefault("components", {})
    components.setdefault("securitySchemes", {}).update(_SCHEMES)
    schemas = components.setdefault("schemas", {})
    if "ErrorAnswer" not in schemas:
        schema = ErrorAnswer.model_json_schema(ref_template="#/components/schemas/{model}")
        schemas.update(schema.pop("$defs", {}))
        schemas["ErrorAnswer"] = schema
    error = {"application/json": {"schema": {"$ref": "#/components/schemas/ErrorAnswer"}}}
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            if method not in _METHODS:
                continue
            operation["security"] = [] if (path, method) in _OPEN else [{"token": []}]
            answers = _ALWAYS | (_WITH_BODY if "requestBody" in operation else {})
            for status, words in answers.items():
                operation["responses"].setdefault(status, {"description": words, "content": error})
    return document
