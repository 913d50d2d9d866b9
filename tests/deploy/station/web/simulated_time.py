# SPDX-License-Identifier: MIT
"""An event loop whose time is simulated: it goes on where nothing is left to do, so that waiting costs next to none.

Sockets are real. A message between two of them takes no time: what is on its way is waited for before time goes on.
"""

import asyncio
import selectors
from collections.abc import Coroutine
from typing import Any, Final, TypeVar

T = TypeVar("T")
_SETTLES_S: Final = 0.0005
"""In real time, for what is on its way between two sockets of this machine."""


class _Selector(selectors.SelectSelector):
    """Where nothing arrives, the time that was to be waited for passes at once."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 0.0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        ready = super().select(0.0 if timeout == 0.0 else _SETTLES_S)
        if ready or timeout == 0.0:
            return ready
        if timeout is None:
            return super().select(None)
        self.now_s += timeout
        return []


class SimulatedLoop(asyncio.SelectorEventLoop):
    """Its time begins at 0, s."""

    def __init__(self) -> None:
        self._simulated = _Selector()
        super().__init__(self._simulated)

    def time(self) -> float:
        return self._simulated.now_s


def run_simulated(work: Coroutine[Any, Any, T]) -> T:
    """Run in simulated time."""
    with asyncio.Runner(loop_factory=SimulatedLoop) as runner:
        return runner.run(work)
