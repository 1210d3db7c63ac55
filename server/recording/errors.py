"""What goes wrong with recordings."""

from server.errors import BadInput


class RecordingError(BadInput):
    """Raised when a file is no recording of ours, or holds too little for what is asked of it."""
