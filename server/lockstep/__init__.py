"""A mission in virtual time: the same core, the same models' code, no waiting."""
