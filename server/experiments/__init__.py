"""Experiments: cells by seeds, flown in worker processes, kept one file a run, told in tables."""
