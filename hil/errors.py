"""The errors of the rig."""

from typing import ClassVar


class RigError(Exception):
    """Root of the rig's errors. The text says what happened, where, and what to do."""

    exit_code: ClassVar[int] = 8


class PlantMismatchError(RigError):
    """A plant does not fit the device it is to stand behind."""


class NoSimulationError(RigError):
    """The robot file names no plant, or has nothing to put one behind."""
