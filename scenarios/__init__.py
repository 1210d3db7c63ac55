"""The scenarios that come with Falconer, as YAML files. Found by name, see `falconer run`."""
