"""A small circuit breaker: an endpoint that keeps failing is left alone for a while."""

import time
from collections.abc import Callable
from dataclasses import dataclass

from llm.chat import ErrorKind, ModelError


@dataclass(slots=True)
class Breaker:
    """Opens after `threshold` failures in a row, lets one probe through per cool-down."""

    threshold: int = 5
    cool_down_s: float = 30.0
    clock: Callable[[], float] = time.monotonic
    failures: int = 0
    opened_at: float | None = None

    def check(self) -> None:
        """Let a call pass, or refuse it.

        Raises:
            ModelError: while the circuit is open.
        """
        if self.opened_at is None:
            return
        rest_s = self.opened_at + self.cool_down_s - self.clock()
        if rest_s > 0.0:
            raise ModelError(
                ErrorKind.CIRCUIT_OPEN,
                f"the model failed {self.failures} times in a row; asked again in {rest_s:.0f} s",
                retry_after_s=rest_s,
            )
        # One probe at a time: whoever comes next waits for another cool-down.
        self.opened_at = self.clock()

    def succeeded(self) -> None:
        """Close the circuit."""
        self.failures = 0
        self.opened_at = None

    def failed(self) -> None:
        """Count a failure; open the circuit when there were too many."""
        self.failures += 1
        if self.failures >= self.threshold:
            self.opened_at = self.clock()
