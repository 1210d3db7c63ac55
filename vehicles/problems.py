"""What is wrong with a JSON text, field by field."""

from pydantic import ValidationError


def problems_of(error: ValidationError, whole: str, most: int | None = None) -> str:
    """Return what is wrong as one line, never with the contents of a field.

    Args:
        error: What the check found.
        whole: What the whole is called, where no field of it is to blame.
        most: So many problems are named, None for all.
    """
    found = error.errors(include_url=False, include_input=False)[:most]
    return "; ".join(
        f"{'.'.join(str(part) for part in one['loc']) or whole}: {one['msg']}" for one in found
    )
