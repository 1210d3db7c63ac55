"""One run of an experiment as a value: what it depends on, and how it is done.

Whatever decides a trial's figures stands in its identity; the identity and the code make its
key, and a trial whose key has a result is never done again.
"""

import importlib.metadata
import json
from collections.abc import Iterator, Mapping
from functools import cache
from hashlib import sha256
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, Protocol

FORMAT = 1
"""Of the results. Raised whenever a figure comes to mean something else."""

KEY_DIGITS = 20

_DECIDING = ("solver", "llm", "vehicles", "server")
_APART = frozenset({"server/api", "server/cli"})
"""Code that flies nothing: a change of it leaves figures as they are."""


class Trial(Protocol):
    """A run to be done. A plain value that can be sent to another process."""

    @property
    def label(self) -> str:
        """Name for people and for files: letters, digits, dots and dashes."""
        ...

    def identity(self) -> Mapping[str, Any]:
        """Return everything the figures depend on, as JSON values. Never a secret."""
        ...

    def perform(self) -> dict[str, Any]:
        """Do it and return the figures as JSON values."""
        ...


def key_of(trial: Trial) -> str:
    """Return the key of a trial: equal exactly where figures must be equal."""
    known = {"format": FORMAT, "code": code_digest(), "trial": dict(trial.identity())}
    text = json.dumps(known, sort_keys=True, allow_nan=False, separators=(",", ":"))
    return sha256(text.encode()).hexdigest()[:KEY_DIGITS]


@cache
def code_digest() -> str:
    """Return a digest of the version and of all sources that may decide a figure."""
    digest = sha256(importlib.metadata.version("falconer").encode())
    for package in _DECIDING:
        for name, file in _sources(resources.files(package), package):
            digest.update(name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def _sources(folder: Traversable, name: str) -> Iterator[tuple[str, Traversable]]:
    for entry in sorted(folder.iterdir(), key=lambda entry: entry.name):
        inner = f"{name}/{entry.name}"
        if entry.is_dir() and inner not in _APART:
            yield from _sources(entry, inner)
        elif entry.name.endswith(".py"):
            yield inner, entry
