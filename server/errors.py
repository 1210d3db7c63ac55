"""The one kind of error that the command line answers with a sentence instead of a traceback."""


class BadInput(Exception):
    """Raised when what somebody gave cannot be used; the message is a sentence for them."""
