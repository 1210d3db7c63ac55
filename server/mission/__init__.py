"""The mission core: sans-I/O, deterministic, the one owner of what the team knows."""
