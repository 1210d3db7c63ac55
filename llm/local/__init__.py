"""A small language model on this machine, served by a worker process of one thread."""
