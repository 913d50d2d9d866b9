# SPDX-License-Identifier: MIT
"""The errors of the rig."""

from segway_ecc.firmware_io.errors import SegwayEccError


class RigError(SegwayEccError):
    """Root of the rig's errors."""

    exit_code = 8


class PlantMismatchError(RigError):
    """A plant does not fit the device it is to stand behind."""


class NoSimulationError(RigError):
    """The robot file names no plant, or has nothing to put one behind."""
