"""Results on disk, one JSON file a run: what is there need not be done again."""

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import structlog

from server.errors import BadInput
from server.experiments.trials import Trial, key_of

log = structlog.get_logger(__name__)


class StoreError(BadInput):
    """Raised when results cannot be kept where they were to be."""


class TrialStore:
    """Owner of an experiment's folder. A file is there whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._runs = folder / "runs"

    def open(self) -> None:
        """Make the folder and prove that it can be written. Raises StoreError."""
        try:
            self._runs.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=self._runs):
                return
        except OSError as error:
            raise StoreError(f"--out {self.folder}: {error.strerror or error}") from error

    def path_of(self, trial: Trial) -> Path:
        """Return where a trial's result is kept."""
        return self._runs / f"{trial.label}-{key_of(trial)}.json"

    def load(self, trial: Trial) -> dict[str, Any] | None:
        """Return a trial's result, None where there is none that can be read."""
        path = self.path_of(trial)
        try:
            result = json.loads(path.read_text("utf-8"))["result"]
        except FileNotFoundError:
            return None
        except (OSError, ValueError, KeyError, TypeError) as error:
            log.warning("a result cannot be read and is made again", file=str(path), why=str(error))
            return None
        return result if isinstance(result, dict) else None

    def save(self, trial: Trial, result: dict[str, Any]) -> None:
        """Keep a trial's result. Raises StoreError."""
        kept = {
            "label": trial.label,
            "key": key_of(trial),
            "identity": dict(trial.identity()),
            "result": result,
        }
        text = json.dumps(kept, indent=1, allow_nan=False) + "\n"
        self.write(self.path_of(trial), text.encode())

    def write(self, path: Path, content: bytes) -> None:
        """Write a file of this experiment, whole or not at all. Raises StoreError."""
        # A name of our own: two experiments may share a folder.
        rough = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            rough.write_bytes(content)
            rough.replace(path)
        except OSError as error:
            raise StoreError(f"{path} cannot be written: {error.strerror or error}") from error
        finally:
            rough.unlink(missing_ok=True)
