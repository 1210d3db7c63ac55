"""An event loop whose time jumps to the next timer: a live minute in a second, nothing waits."""

import asyncio
import selectors
from collections.abc import Callable, Coroutine
from typing import Any, TypeVar

T = TypeVar("T")


class VirtualLoop(asyncio.SelectorEventLoop):
    """Runs what waits for time without waiting. Worker threads run at once, in the loop."""

    def __init__(self) -> None:
        self._virtual_s = 1000.0
        super().__init__(_Jumping(self))

    def time(self) -> float:
        """Return virtual seconds."""
        return self._virtual_s

    def jump(self, seconds: float) -> None:
        """Let time pass."""
        self._virtual_s += seconds

    def run_in_executor(  # type: ignore[override]
        self, executor: Any, func: Callable[..., T], *args: Any
    ) -> asyncio.Future[T]:
        """Run a blocking call here and now: time stands still for it."""
        future: asyncio.Future[T] = self.create_future()
        future.set_result(func(*args))
        return future


class _Jumping(selectors.DefaultSelector):
    def __init__(self, loop: VirtualLoop) -> None:
        super().__init__()
        self._loop = loop

    def select(self, timeout: float | None = None) -> Any:
        if timeout is None:
            raise RuntimeError("everything waits, and nothing will ever happen")
        events = super().select(0)
        if not events:
            self._loop.jump(timeout)
        return events


def run(main: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time."""
    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        return runner.run(main)
