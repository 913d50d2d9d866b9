# SPDX-License-Identifier: MIT
"""The processes of the robot that is shown: plant, guard and node; what was killed can be started again."""

import contextlib
import os
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, Self, TypeAlias

from segway_ecc.hil.errors import RigError
from segway_ecc.hil.processes import Command, command

Part: TypeAlias = Literal["node", "guard"]
_STARTS_WITHIN_S: Final = 30.0
_ANSWERS_WITHIN_S: Final = 2.0
_REFUSED: Final = "refused:"


@dataclass(frozen=True, slots=True)
class PartsSetup:
    """What is started.

    Attributes:
        robot: A robot file, or the name of one that ships with the package.
        bus: The options that name the bus, which all processes share.
        folder: Where messages and logs go.
        node: More options of the node.
    """

    robot: str
    bus: Sequence[str]
    folder: Path
    node: Sequence[str] = ()


class Parts(ABC):
    """The robot that is shown, for whoever tries things on it."""

    def tell(self, line: str) -> int:
        """Have the plant obey a line of `hil.drill.plant_control`; return when it did, ns by the robot's clock.

        Raises:
            RigError: It refuses, or does not answer.
        """
        stamp, answer = self._ask(line)
        if answer.startswith(_REFUSED):
            raise RigError(f"the plant: {answer}")
        return stamp

    def last_driven_ns(self) -> int | None:
        """When a motor was last driven, ns by the robot's clock; None where none ever was."""
        word = self._ask("driven")[1].split()[-1]
        return None if word == "never" else int(word)

    @abstractmethod
    def kill(self, part: Part) -> int:
        """Kill a part as a crash would; return when, ns by the robot's clock."""

    @abstractmethod
    def revive(self) -> None:
        """Start guard and node where they do not run."""

    @abstractmethod
    def _ask(self, line: str) -> tuple[int, str]:
        """Have the plant obey a line; when it did, ns, and its answer."""


class DemoParts(Parts):
    """What runs while the context lasts, as processes; their clock is the machine's monotonic one.

    A process ends with the thread that started it: the context and `revive` belong to threads that last as long.
    """

    def __init__(self, setup: PartsSetup) -> None:
        """Start nothing yet."""
        self._setup = setup
        self._stack = contextlib.ExitStack()
        self._starts = 0
        self._parts: dict[Part, Command] = {}

    def __enter__(self) -> Self:
        """Start plant, guard and node.

        Raises:
            ProcessFailedError: The plant does not run.
        """
        with self._stack:
            self._plant = self._start("plant", "--control", listens=True)
            self._plant.ask("heal", _STARTS_WITHIN_S)  # it answers once it runs
            self.revive()
            self._stack = self._stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def kill(self, part: Part) -> int:
        """See `Parts.kill`."""
        process = self._parts[part].process
        os.kill(process.pid, signal.SIGKILL)
        killed_ns = time.monotonic_ns()
        process.wait()
        return killed_ns

    def revive(self) -> None:
        """See `Parts.revive`."""
        starts: Sequence[tuple[Part, Callable[[], Command]]] = (
            ("guard", lambda: self._start("guard")),
            ("node", lambda: self._start("run", *self._setup.node)),
        )
        for part, start in starts:
            if part not in self._parts or self._parts[part].process.poll() is not None:
                self._parts[part] = start()

    def _start(self, verb: str, *words: str, listens: bool = False) -> Command:
        self._starts += 1
        setup = self._setup
        messages = setup.folder / f"{self._starts}-{verb}.txt"
        line = [verb, setup.robot, *setup.bus, *words]
        return self._stack.enter_context(command(line, messages, listens=listens))

    def _ask(self, line: str) -> tuple[int, str]:
        stamp, _, answer = self._plant.ask(line, _ANSWERS_WITHIN_S).partition(" ")
        return int(stamp), answer
