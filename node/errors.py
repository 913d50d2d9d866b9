# SPDX-License-Identifier: MIT
"""The errors of the node; each ends a command with its own exit code and one line of text."""

from collections.abc import Iterable

from segway_ecc.firmware_io.errors import SegwayEccError


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
