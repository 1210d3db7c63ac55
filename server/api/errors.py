"""One error shape for everything: {"error": {"code", "message", "details"}}."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from starlette.exceptions import HTTPException

from server.api.openapi import allowed_methods

log = structlog.get_logger(__name__)

MAX_SHOWN_PROBLEMS = 20


class ServiceError(Exception):
    """Raised when a request cannot be done; carries what the client is told."""

    def __init__(
        self,
        code: str,
        message: str,
        status: int = HTTPStatus.BAD_REQUEST,
        details: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.status = int(status)
        self.details = dict(details or {})


def error_body(code: str, message: str, details: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return the one error shape."""
    return {"error": {"code": code, "message": message, "details": dict(details or {})}}


def error_response(error: ServiceError) -> JSONResponse:
    """Return an error as an HTTP response; one that passes says when in Retry-After too."""
    body = error_body(error.code, error.message, error.details)
    wait_s = error.details.get("retry_after_s")
    headers = None if wait_s is None else {"retry-after": str(wait_s)}
    return JSONResponse(body, status_code=error.status, headers=headers)


def install(app: FastAPI) -> None:
    """Answer every failure of an application in the one shape."""
    app.add_exception_handler(ServiceError, _on_service_error)
    app.add_exception_handler(HTTPException, _on_http_exception)
    app.add_exception_handler(RequestValidationError, _on_invalid_request)
    app.add_exception_handler(Exception, _on_bug)


async def _on_service_error(request: Request, error: Exception) -> JSONResponse:
    if not isinstance(error, ServiceError):
        raise error
    return error_response(error)


async def _on_http_exception(request: Request, error: Exception) -> JSONResponse:
    """Answer what the framework itself refuses: no such route, wrong method, broken body."""
    if not isinstance(error, HTTPException):
        raise error
    phrase = HTTPStatus(error.status_code).phrase
    code = phrase.lower().replace(" ", "_").replace("-", "_")
    message = f"{request.method} {request.url.path}: {error.detail or phrase}"
    headers = dict(error.headers or {})
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED:
        below = request.scope["path"].removeprefix(request.scope.get("root_path", ""))
        headers["allow"] = ", ".join(allowed_methods(request.app, below)) or headers.get(
            "allow", ""
        )
    return JSONResponse(error_body(code, message), status_code=error.status_code, headers=headers)


async def _on_invalid_request(request: Request, error: Exception) -> JSONResponse:
    """Name every field that is wrong, and how; what was sent is not repeated."""
    if not isinstance(error, RequestValidationError):
        raise error
    problems = [
        {"field": ".".join(str(part) for part in problem["loc"]), "problem": problem["msg"]}
        for problem in error.errors()[:MAX_SHOWN_PROBLEMS]
    ]
    first = problems[0] if problems else {"field": "body", "problem": "invalid"}
    body = error_body(
        "invalid_request", f"{first['field']}: {first['problem']}", {"problems": problems}
    )
    return JSONResponse(body, status_code=HTTPStatus.UNPROCESSABLE_ENTITY)


async def _on_bug(request: Request, error: Exception) -> JSONResponse:
    log.error("request failed", path=request.url.path, exc_info=error)
    return JSONResponse(
        error_body("internal_error", "The server failed on this request; its log says why."),
        status_code=HTTPStatus.INTERNAL_SERVER_ERROR,
    )
