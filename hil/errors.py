# SPDX-License-Identifier: MIT
"""The errors of the rig."""

from collections.abc import Sequence

from segway_ecc.firmware_io.errors import SegwayEccError


class RigError(SegwayEccError):
    """Root of the rig's errors."""

    exit_code = 8


class PlantMismatchError(RigError):
    """A plant does not fit the device it is to stand behind."""


class RunFailedError(RigError):
    """A run failed each time that it was tried.

    Attributes:
        failures: What happened in each try.
    """

    exit_code = 14

    def __init__(self, text: str, failures: Sequence[SegwayEccError] = ()) -> None:
        """State what failed, why, and the remedy."""
        self.failures = failures
        super().__init__(text)


class NoSimulationError(RigError):
    """The robot file names no plant, or has nothing to put one behind."""
