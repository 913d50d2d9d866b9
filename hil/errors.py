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
    """A run failed each time that it was tried; `failures` is what happened in each try.

    Attributes:
        is_spoiled: Whether each of them was of a kind that a stall of the machine causes, and one came with it.
    """

    exit_code = 14

    def __init__(self, text: str, failures: Sequence[SegwayEccError] = ()) -> None:
        """State what failed, why, and the remedy."""
        self.failures = failures
        self.is_spoiled = bool(failures) and all(isinstance(each, SpoiledRunError) for each in failures)
        super().__init__(text)


class SpoiledRunError(RigError):
    """A run failed as it does where the machine stalls, which it did meanwhile; in lock step it does not fail."""


class SerialNameError(RigError):
    """The name of a simulated serial line is taken by something that this program did not make, or cannot be used."""

    exit_code = 2


class NoSimulationError(RigError):
    """The robot file names no plant, or has nothing to put one behind."""
