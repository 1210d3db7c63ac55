"""What an experiment leaves in its folder: tables, figures and a page that holds both."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from server.experiments.store import TrialStore
from server.experiments.tables import Table


@dataclass(frozen=True, slots=True)
class Report:
    """An experiment's outcome, ready to be read."""

    title: str
    notes: str
    tables: Mapping[str, Table]
    """By the name of their file."""

    figures: Mapping[str, bytes]
    """PNG, by the name of their file."""

    result: Mapping[str, Any]
    """Everything as JSON values."""

    def as_text(self) -> str:
        """Return the result as JSON."""
        return json.dumps(self.result, indent=2, allow_nan=False)

    def as_page(self) -> str:
        """Return title, notes, tables and figures as a page of Markdown."""
        page = [f"# {self.title}\n", f"{self.notes}\n"]
        page += [f"## {table.title}\n\n{table.markdown()}" for table in self.tables.values()]
        page += [f"![{name}]({name}.png)\n" for name in self.figures]
        return "\n".join(page)

    def write(self, store: TrialStore) -> None:
        """Write NAME.csv per table, NAME.png per figure, report.md and result.json.

        Raises StoreError.
        """
        for name, table in self.tables.items():
            store.write(store.folder / f"{name}.csv", table.csv().encode())
        for name, figure in self.figures.items():
            store.write(store.folder / f"{name}.png", figure)
        store.write(store.folder / "report.md", self.as_page().encode())
        store.write(store.folder / "result.json", f"{self.as_text()}\n".encode())
