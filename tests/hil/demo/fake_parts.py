# SPDX-License-Identifier: MIT
"""The parts of a robot without processes: what they were told is kept."""

from collections.abc import Callable
from pathlib import Path

from segway_ecc.hil.demo.parts import DemoParts, Part, PartsSetup
from segway_ecc.hil.errors import RigError
from segway_ecc.testing import ScriptedClock


class FakeParts(DemoParts):
    """Obeys at the time of its clock; the motors are driven up to `driven_ns`, or still, where that is a function."""

    def __init__(self, clock: ScriptedClock) -> None:
        super().__init__(PartsSetup("segway", (), Path()))
        self.clock = clock
        self.driven: Callable[[], int | None] = clock.now_ns
        self.lines = list[str]()
        self.killed = list[Part]()
        self.revivals = 0
        self.refuses = ""

    def tell(self, line: str) -> int:
        if line == self.refuses:
            raise RigError(f"the plant: refused: {line}")
        self.lines.append(line)
        return self.clock.now_ns()

    def last_driven_ns(self) -> int | None:
        return self.driven()

    def kill(self, part: Part) -> int:
        self.killed.append(part)
        return self.clock.now_ns()

    def revive(self) -> None:
        self.revivals += 1
