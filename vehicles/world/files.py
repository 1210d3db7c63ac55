"""A world's setup as JSON, for a process that simulates it."""

from typing import Final

from pydantic import TypeAdapter, ValidationError

from vehicles.world.setup import WorldSetup

_SETUP: Final = TypeAdapter(WorldSetup)


class WorldFileError(ValueError):
    """Raised when a text does not describe a world; the message names the fields."""


def dump(setup: WorldSetup) -> str:
    """Return the setup as one line of JSON."""
    return _SETUP.dump_json(setup).decode()


def load(text: str | bytes) -> WorldSetup:
    """Return the setup that a JSON text describes.

    Raises:
        WorldFileError: When it is not JSON, a field is missing or wrong, or a number is not
            finite.
    """
    try:
        return _SETUP.validate_json(text)
    except ValidationError as error:
        problems = (
            f"{'.'.join(str(part) for part in problem['loc']) or 'world'}: {problem['msg']}"
            for problem in error.errors(include_url=False, include_input=False)
        )
        raise WorldFileError("; ".join(problems)) from None
