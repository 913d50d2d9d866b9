# SPDX-License-Identifier: MIT
"""The errors of an update; each ends `segway-ecc deploy` with its own exit code and one line of text."""

from segway_ecc.node.errors import NobodyListensError, NodeError, RobotLostError


class UpdateRefusedError(NodeError):
    """The robot does not do what it was asked for, and runs what it ran before."""

    exit_code = 11


class UpdateFailedError(NodeError):
    """The release was not healthy; the text names what the robot went back to."""

    exit_code = 12


class UnreachableError(NobodyListensError):
    """No connection to the robot could be made."""


class ConnectionLostError(RobotLostError):
    """The connection was lost during an update; the robot ends by itself what it had begun to switch."""
