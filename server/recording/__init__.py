"""Recordings: everything that went into a mission core and came out of it, in one MCAP file."""
