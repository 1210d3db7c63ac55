"""The command line `falconer`."""

from server.cli.app import app, main

__all__ = ["app", "main"]
