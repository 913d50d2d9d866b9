# SPDX-License-Identifier: MIT
"""Who has the robot in hand: what they can be told to do, and how they answer."""

import enum
import os
import select
from typing import Protocol, TextIO


@enum.unique
class Task(enum.StrEnum):
    """What a person is told; they answer once it is done."""

    LIFT = "Put the robot on a stand with both wheels free in the air, upright. Keep hands, hair and cables away."
    TURN_LEFT_WHEEL = "Turn the LEFT wheel by hand exactly one turn FORWARD, as it turns when the robot drives ahead."
    TURN_RIGHT_WHEEL = "Turn the RIGHT wheel by hand exactly one turn FORWARD, as it turns when the robot drives ahead."
    KEEP_CLEAR = "The wheels will turn by themselves, slowly. Keep clear; have the e-stop in reach."
    HOLD_UPRIGHT = "Hold the robot upright and still."
    TILT_FORWARD = "Tilt the robot FORWARD, nose down, by some 40 degrees, and hold it there."
    TILT_RIGHT = "Tilt the robot to the RIGHT, right side down, by some 40 degrees, and hold it there."
    TURN_LEFT = "Turn the upright robot a QUARTER TURN to the LEFT, seen from above, and hold it there."
    BALANCE = "Set it on its wheels and hold it with two fingers where it tips neither forward nor back."
    PUSH = "On the floor, upright: push it straight ahead by exactly ONE METRE, wheels rolling. Hold it there."
    SPIN = "On the floor, upright: turn it on the spot ONE WHOLE TURN to the LEFT, wheels rolling. Hold it there."
    LOOK_UP_LIMITS = (
        "The lines above are not read back: look them up in the drives' vendor's tool. Confirm: each allows what is "
        "named, and no more than the motors bear."
    )
    PRESS_STOP = "Press the E-STOP while the wheels turn."
    SEE_WHEELS_STOP = "The drives fell silent. Confirm: the wheels came to rest by themselves, and turn freely by hand."
    RELEASE_STOP = "Release the e-stop again, and see that the drives are on."
    START_GUARD = "Start the guard in another terminal: segway-ecc guard ROBOT"
    END_GUARD = "End the guard again (Ctrl-C there)."
    SET_DOWN = "Lay the robot on the floor on its bumper, with two metres free ahead and behind."
    HOLD_LOOSELY = "Hold it loosely by its top: it will stand up and balance. Catch it if it drives off."
    STAND_CLEAR = "Stand clear, two metres away, e-stop in hand: it will stand up and balance alone."


@enum.unique
class Answer(enum.Enum):
    """What a person answers."""

    DONE = enum.auto()
    CANNOT = enum.auto()


class Person(Protocol):
    """Is told what to do, and looked at in every period of the loop, which goes on meanwhile."""

    def begin(self, task: Task) -> None:
        """Tell them what to do."""

    def answer(self) -> Answer | None:
        """What they answered; None while they are at it."""

    def read(self, line: str) -> None:
        """Show them what came of a step."""


class TerminalPerson:
    """Somebody at a terminal: Enter when it is done, n and Enter where it cannot be done; see `Person`."""

    def __init__(self, descriptor: int, out: TextIO) -> None:
        """Read answers from a file descriptor, and write to `out`."""
        self._descriptor, self._out = descriptor, out
        self._typed = b""
        self._is_gone = False

    def begin(self, task: Task) -> None:
        """Tell them what to do; what was typed before answers nothing."""
        self._read()
        self._typed = b""
        self._write(f"\n> {task}\n  Enter when done, n and Enter if it cannot be done: ")

    def answer(self) -> Answer | None:
        """What they typed, once it is a line; a terminal that is gone can do nothing."""
        self._read()
        if self._is_gone:
            return Answer.CANNOT
        line, end, self._typed = self._typed.partition(b"\n")
        if not end:
            self._typed = line
            return None
        return Answer.CANNOT if line.strip().lower().startswith(b"n") else Answer.DONE

    def read(self, line: str) -> None:
        """Show a line."""
        self._write(f"{line}\n")

    def _read(self) -> None:
        while not self._is_gone and select.select([self._descriptor], [], [], 0.0)[0]:
            data = os.read(self._descriptor, 4096)
            self._typed += data
            self._is_gone = not data

    def _write(self, text: str) -> None:
        self._out.write(text)
        self._out.flush()
