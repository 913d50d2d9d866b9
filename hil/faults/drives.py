# SPDX-License-Identifier: MIT
"""Simulated drives that end with an error of their own, as faults have them."""

from collections.abc import Callable
from typing import Any

from segway_ecc.hil.errors import NoSimulationError
from segway_ecc.hil.faults.fault import Injections, active


class FailingDrives:
    """Has drives fail, once for each fault that asks for it."""

    def __init__(self, drives: Any, fail: Callable[[Any], None] | None, injections: Injections) -> None:  # noqa: ANN401 - the family's own
        """Have `drives` fail by `fail`, as `SimulatedDrives` of their family has it."""
        self._drives, self._fail = drives, fail
        self._injections = injections.of("drive")
        self._failed = 0

    def act(self) -> None:
        """Do what is due now.

        Raises:
            NoSimulationError: The family does not simulate that.
        """
        if self._failed == len(self._injections):  # as in most ticks of most runs
            return
        for _ in active(self._injections)[self._failed :]:
            if self._fail is None:
                raise NoSimulationError("the simulated drives of this robot cannot fail: their family has no 'fail'")
            self._fail(self._drives)
            self._failed += 1
