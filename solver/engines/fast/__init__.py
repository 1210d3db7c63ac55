"""The fast engine: projected Newton with exact derivatives, in machine code."""

from solver.engines.fast.engine import FastEngine

__all__ = ["FastEngine"]
