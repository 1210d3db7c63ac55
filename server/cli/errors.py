"""What goes wrong on the command line."""


class UsageError(Exception):
    """Raised when an option's value cannot be used; the message names it and says why."""
