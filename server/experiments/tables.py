"""Tables that can be read (Markdown) and read on (CSV)."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from server.experiments.statistics import Estimate

Cell = str | int | float | Estimate | None


@dataclass(frozen=True, slots=True)
class Column:
    """One column."""

    key: str
    """Its name in CSV and JSON."""

    head: str
    """Its name for people."""

    digits: int = 1
    signed: bool = False
    """Differences: a plus sign is shown."""


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under columns; a row may leave cells out."""

    title: str
    columns: tuple[Column, ...]
    rows: Sequence[Mapping[str, Cell]]

    def markdown(self) -> str:
        """Return the table in Markdown, means with their 95 % intervals as "mean ± half"."""
        lines = [f"| {' | '.join(column.head for column in self.columns)} |"]
        lines.append("|" + "---|" * len(self.columns))
        for row in self.rows:
            cells = [_words(row.get(column.key), column) for column in self.columns]
            lines.append(f"| {' | '.join(cells)} |")
        return "\n".join(lines) + "\n"

    def csv(self) -> str:
        """Return the table as CSV; an estimate becomes two columns, nothing is rounded."""
        records = self.records()
        names = list(dict.fromkeys(name for record in records for name in record))
        text = io.StringIO()
        writer = csv.DictWriter(text, names, lineterminator="\n")
        writer.writeheader()
        writer.writerows(records)
        return text.getvalue()

    def records(self) -> list[dict[str, str | int | float | None]]:
        """Return plain records, an estimate as KEY and KEY_half_width."""
        return [self._record(row) for row in self.rows]

    def _record(self, row: Mapping[str, Cell]) -> dict[str, str | int | float | None]:
        record: dict[str, str | int | float | None] = {}
        for column in self.columns:
            cell = row.get(column.key)
            if isinstance(cell, Estimate):
                record[column.key] = cell.mean
                record[f"{column.key}_half_width"] = cell.half_width
            else:
                record[column.key] = cell
        return record


def _words(cell: Cell, column: Column) -> str:
    sign = "+" if column.signed else ""
    match cell:
        case None:
            return "-"
        case str():
            return cell.replace("|", "/")
        case Estimate():
            mean = f"{cell.mean:{sign}.{column.digits}f}"
            return (
                mean if cell.half_width is None else f"{mean} ± {cell.half_width:.{column.digits}f}"
            )
        case int():
            return f"{cell:{sign}d}"
        case float():
            return f"{cell:{sign}.{column.digits}f}"
