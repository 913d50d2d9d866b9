# SPDX-License-Identifier: MIT
"""Errors inside a simulated CiA 402 drive."""

from segway_ecc.firmware_io.drives.cia402.frames import DriveState, Emergency
from segway_ecc.hil.devices.cia402 import SimulatedDrive

_FAULT = Emergency(0x2310, 0x03)
"""Continuous over-current; error register: generic, and current."""


def latch_fault(drive: SimulatedDrive) -> None:
    """Let an error happen inside a drive."""
    drive.slave.send_emergency(_FAULT)
    drive.state = DriveState.FAULT_REACTION_ACTIVE
