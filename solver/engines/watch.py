"""Looks at a CasADi solver's iterations from inside: keeps the best one, stops at a deadline."""

import time
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from solver.arrays import FloatArray

_STOP, _GO_ON = 1, 0


class Watch(ca.Callback):
    """An iteration callback for a solver without general constraints."""

    def __init__(self, variables: int, parameters: int) -> None:
        ca.Callback.__init__(self)
        self._rows = {"x": variables, "lam_x": variables, "f": 1, "lam_p": parameters}
        self._deadline: float | None = None
        self._least = np.inf
        self.best: FloatArray | None = None
        """The iterate of least objective since `begin`."""
        self.construct("watch", {})

    def begin(self, deadline: float | None) -> None:
        """Forget the last run; stop the next one at a reading of the monotonic clock."""
        self._deadline, self._least, self.best = deadline, np.inf, None

    def get_n_in(self) -> int:
        """Return the number of inputs: whatever a solver puts out."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return 1

    def get_sparsity_in(self, index: int) -> Any:
        """Return the shape of one input."""
        name = ca.nlpsol_out(index)
        return ca.Sparsity.dense(self._rows.get(name, 0), 1)

    def eval(self, arguments: Sequence[ca.DM]) -> list[int]:
        """Take note of an iterate and answer whether to go on."""
        value = float(arguments[ca.nlpsol_out().index("f")])
        if value < self._least:
            self._least = value
            self.best = np.asarray(arguments[ca.nlpsol_out().index("x")]).ravel()
        late = self._deadline is not None and time.monotonic() >= self._deadline
        return [_STOP if late else _GO_ON]
