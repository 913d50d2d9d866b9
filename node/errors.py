# SPDX-License-Identifier: MIT
"""The errors of the node; each ends a command with its own exit code and one line of text."""

from collections.abc import Iterable
from typing import Final

from segway_ecc.firmware_io.errors import SegwayEccError

_LONGEST: Final = 500


def shortened(text: str) -> str:
    """A text from outside, or its beginning where it is too long for a line of a message: 500 characters."""
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def failure_text(error: BaseException) -> str:
    """What an exception of a model says, which may be anything, in one line with the place where it was raised."""
    where = error.__traceback__
    while where is not None and where.tb_next is not None:
        where = where.tb_next
    place = "" if where is None else f" ({where.tb_frame.f_code.co_filename}:{where.tb_lineno})"
    return f"{exception_text(error)}{place}"


def exception_text(error: BaseException) -> str:
    """The same without the place."""
    try:
        text = printable(" ".join(str(error).split()))
    except BaseException:  # noqa: BLE001 - an exception of a model may fail at that too, even by SystemExit
        text = "it cannot be shown"
    return f"{type(error).__name__}{': ' if text else ''}{shortened(text)}"


def printable(text: str) -> str:
    """A text from outside that logs and ROS take: what UTF-8 cannot hold, half of a surrogate pair, as an escape."""
    return text.encode("utf-8", "backslashreplace").decode()


def plain_number(text: str) -> float:
    """A number in plain digits; Python takes 1_0 and the digits of every script.

    Raises:
        ValueError: It is none.
    """
    if "_" in text or not text.isascii():
        raise ValueError(f"could not convert string to float: '{text}'")
    return float(text)


def whole_number(text: str) -> int:
    """The same for a whole number."""
    plain_number(text)
    return int(text)


class NodeError(SegwayEccError):
    """Root of the node's errors."""


class ConfigurationError(NodeError):
    """The robot file, a sequence file or an argument cannot be used as it stands."""

    exit_code = 2


class ModelError(NodeError):
    """A model cannot be loaded, or refuses a value."""

    exit_code = 3


class UnknownNameError(ModelError):
    """A name that the model or the robot does not have."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        """State the kind of thing looked for, the name, and the names that exist."""
        self.name = name
        self.known = tuple(known)
        super().__init__(f"no {kind} is called '{name}'; there is {', '.join(self.known) or 'none'}")


class ModelFailedError(ModelError):
    """A model's own equations raised an exception."""


class RosUnavailableError(NodeError):
    """ROS 2 is needed and is not installed or not sourced."""

    exit_code = 5


class AbandonedError(NodeError):
    """A signal ended what was going on."""


class NobodyListensError(NodeError):
    """No model node found our set-points in time, or it does not follow them."""

    exit_code = 6


class RobotLostError(NodeError):
    """The model node fell silent, or stopped following, while it was being commanded."""

    exit_code = 7


class RecordingError(NodeError):
    """A log cannot be written as asked."""

    exit_code = 9


class SequenceError(NodeError):
    """The robot refused a sequence, or what it published of it did not arrive whole."""

    exit_code = 13
