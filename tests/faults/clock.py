"""The wall clock of the product's processes, as a test turns it (see `fakeclock`)."""

from pathlib import Path


def set_clock(file: Path, offset_s: float) -> None:
    """Let the wall clock be off by so much from now on.

    Processes read the file at every look at their clock: none may find it empty.
    """
    fresh = file.with_name(f"{file.name}.new")
    fresh.write_text(str(offset_s))
    fresh.replace(file)
