"""`python -m server.cli` is `falconer`."""

from server.cli.app import main

main()
