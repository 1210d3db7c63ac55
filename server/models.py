"""Which language model advises a mission: a built-in one, nobody, or any endpoint."""

from urllib.parse import urlsplit

NOT_BUILT = {
    "local": "the embedded model is not built yet",
    "exact": "the assignment solver is not built yet",
}


class ModelUnavailable(Exception):
    """Raised when a chosen model cannot be had; the message says why and what to do."""


def check_choice(choice: str) -> str:
    """Return the choice if it names a model, nobody, or an http(s) address.

    Raises ModelUnavailable otherwise.
    """
    if choice in NOT_BUILT:
        raise ModelUnavailable(f"--llm {choice}: {NOT_BUILT[choice]}; use mock, none or a URL")
    if choice in {"mock", "none"}:
        return choice
    parts = urlsplit(choice)
    if parts.scheme in {"http", "https"} and parts.hostname:
        return choice
    raise ModelUnavailable(f"--llm {choice[:80]!r}: expected mock, none or an http(s) address")
