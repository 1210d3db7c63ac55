"""What goes wrong on the command line."""

from server.errors import BadInput


class UsageError(BadInput):
    """Raised when an option's value cannot be used; the message names it and says why."""
