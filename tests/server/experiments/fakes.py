"""Trials that fly nothing."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Counted:
    """Writes a mark for every time it is really done."""

    name: str
    folder: Path
    value: float = 1.0
    fails: bool = False
    takes_s: float = 0.0

    @property
    def label(self) -> str:
        return self.name

    def identity(self) -> Mapping[str, Any]:
        return {"name": self.name, "value": self.value}

    def perform(self) -> dict[str, Any]:
        with (self.folder / self.name).open("a") as marks:
            marks.write("x")
        time.sleep(self.takes_s)
        if self.fails:
            raise RuntimeError(f"{self.name} was to fail\nbadly")
        return {"value": self.value, "process": os.getpid()}

    def times_done(self) -> int:
        mark = self.folder / self.name
        return len(mark.read_text()) if mark.exists() else 0


@dataclass(frozen=True, slots=True)
class Deadly:
    """Ends the process that does it."""

    label: str = "deadly"

    def identity(self) -> Mapping[str, Any]:
        return {"label": self.label}

    def perform(self) -> dict[str, Any]:
        os._exit(9)


@dataclass(frozen=True, slots=True)
class Threads:
    """Tells how many threads numerics may use."""

    label: str

    def identity(self) -> Mapping[str, Any]:
        return {"label": self.label}

    def perform(self) -> dict[str, Any]:
        names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
        return {name: os.environ.get(name) for name in names}
