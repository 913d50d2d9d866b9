# SPDX-License-Identifier: MIT
"""Runs in real time that fail are repeated, and which they were and why is kept."""

from collections.abc import Callable
from typing import Final, TypeVar

from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.hil.errors import RigError, RunFailedError
from segway_ecc.node.errors import NodeError

TRIES: Final = 3
"""Of a run in real time; what runs on a simulated clock, or on none, is never repeated."""

_REMEDY: Final = "end other programs on this machine and try again, or choose other seats with --seat"
_T = TypeVar("_T")


class Repeats:
    """Repeats what fails.

    Attributes:
        causes: A line for each run that was repeated, with the reason.
    """

    def __init__(self, on_repeat: Callable[[str], object] = lambda _cause: None) -> None:
        """Call `on_repeat` with each line of `causes`."""
        self.causes: list[str] = []
        self._on_repeat = on_repeat

    def run(self, what: str, tries: int, once: Callable[[str], _T], is_over: Callable[[], bool] = lambda: False) -> _T:
        """Run `once` until it succeeds.

        Args:
            what: Names it in messages.
            tries: How many times it may fail.
            once: Called with a suffix for the names of this try's files, empty in the first one.
            is_over: Whether nothing is to be repeated any more.

        Raises:
            NodeError, RigError: It failed, and may not be repeated.
            RunFailedError: It failed in each of several tries.
        """
        failures: list[SegwayEccError] = []
        while True:
            try:
                return once(f"_try_{len(failures) + 1}" if failures else "")
            except (NodeError, RigError) as error:
                failures.append(error)
                if tries == 1 or is_over():
                    raise
                if len(failures) == tries:
                    text = f"{what} failed in each of {tries} tries, the last time: {error}; {_REMEDY}"
                    raise RunFailedError(text, failures) from error
                self.causes.append(f"{what}, try {len(failures)} of {tries}: {error}")
                self._on_repeat(self.causes[-1])
