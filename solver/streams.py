"""Counter-based random streams: the same dice whatever is rolled before, after or instead.

A draw is a pure function of (seed, purpose, robot, other, step). Two policies flown under one
seed therefore meet the same dice wherever they ask the same question, and a draw left out
shifts no other. Each draw is one block of Philox-4x64 (Salmon et al., "Parallel random
numbers: as easy as 1, 2, 3", 2011): the key is made of the seed and the purpose, the counter
of the robot, the other party and the step.
"""

from hashlib import blake2b

import numpy as np

from solver.arrays import FloatArray

_WORD = 2**64 - 1


class Streams:
    """All random numbers of one mission or world.

    One owner at a time: a draw is not safe against another one from a second thread.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self._dice: dict[str, _Dice] = {}

    def uniform(self, purpose: str, robot: int, other: int, step: int) -> float:
        """Return a number from the uniform distribution on [0, 1)."""
        return float(self._at(purpose, robot, other, step).random())

    def normal(self, purpose: str, robot: int, other: int, step: int) -> float:
        """Return a number from the standard normal distribution."""
        return float(self._at(purpose, robot, other, step).standard_normal())

    def normals(self, purpose: str, robot: int, other: int, step: int, count: int) -> FloatArray:
        """Return `count` independent standard normal numbers, shape (count,).

        The first of them is what `normal` returns for the same arguments.
        """
        return self._at(purpose, robot, other, step).standard_normal(count)

    def _at(self, purpose: str, robot: int, other: int, step: int) -> np.random.Generator:
        dice = self._dice.get(purpose)
        if dice is None:
            dice = self._dice[purpose] = _Dice(self.seed, purpose)
        return dice.at(robot, other, step)


class _Dice:
    """The generator of one purpose, put on a counter before every draw."""

    def __init__(self, seed: int, purpose: str) -> None:
        digest = blake2b(f"{seed}/{purpose}".encode(), digest_size=16).digest()
        self._bits = np.random.Philox(key=np.frombuffer(digest, dtype="<u8"))
        self._state = self._bits.state
        self._counter = self._state["state"]["counter"]
        self._generator = np.random.Generator(self._bits)

    def at(self, robot: int, other: int, step: int) -> np.random.Generator:
        # Word 0 counts the blocks of one draw; an empty buffer forces a fresh block.
        self._counter[:] = (0, robot & _WORD, other & _WORD, step & _WORD)
        self._bits.state = self._state
        return self._generator
