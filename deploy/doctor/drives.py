# SPDX-License-Identifier: MIT
"""The drives as the robot file has them: their watchdogs, and the serial line that the robot falls back on."""

import errno
import re
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, graded, warning
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.firmware_io.build import serial_of
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.serial_port import open_remedy

_CYCLES: Final = 3
_NUMBERED_AS_FOUND: Final = re.compile(r"/dev/tty(USB|ACM)\d+")
_TAKEN: Final = (errno.EAGAIN, errno.EBUSY)


def check_drives(_machine: System, workload: Workload) -> Iterator[Finding]:
    """How long a drive goes on by itself, how that is made sure, and whether it outlasts a late cycle."""
    match workload.hardware:
        case None:
            yield good("drives' watchdogs", "no drives" if workload.robot is not None else "no robot is named")
            return
        case WheelBoardSettings(watchdog_s=seconds):
            how = "set by the node, and read back before it arms"
        case OdriveSettings(watchdog_s=seconds):
            how = "set with odrivetool; the node has each axis prove it before it arms"
        case VescSettings(timeout_set_s=seconds):
            how = "set with VESC Tool; the node measures it before it arms"
        case Cia402Settings(watchdog_s=seconds):
            how = "a heartbeat time that the node sets, and reads back before it arms"
    period_s, found = workload.period_ns * 1e-9, f"{seconds * 1e3:g} ms, {how}"
    fits = seconds >= _CYCLES * period_s
    yield graded(
        "drives' watchdogs",
        found if fits else f"{found}; the loop's period is {period_s * 1e3:g} ms",
        f"fewer than {_CYCLES} cycles: one that is late or lost may switch the motors off",
        "a longer hardware.watchdog_s in the robot file (VESC: timeout_set_s, and VESC Tool), or a faster model",
        fits=fits,
    )


def check_serial(machine: System, workload: Workload) -> Iterator[Finding]:
    """Whether the port of the robot file is there, opens, and will have the same name tomorrow."""
    settings = None if workload.hardware is None else serial_of(workload.hardware)
    if settings is None:
        yield good("serial line", "none is asked for")
        return
    title = f"serial {settings.port}"
    try:
        machine.probes.open_port(settings)
    except OSError as error:
        grade, effect = bad, "when the bus is lost there is nothing to fall back on"
        if error.errno in _TAKEN:
            grade, effect = warning, "as it should be while the robot runs; else the robot cannot open it"
        yield grade(title, f"does not open: {error.strerror or error}", effect, open_remedy(settings, error))
    else:
        yield good(title, "opens")
    if _NUMBERED_AS_FOUND.fullmatch(settings.port):
        yield warning(
            f"{title} name",
            "numbered in the order in which adapters are found",
            "with a second adapter, or after it was unplugged, the name may be another one's",
            "write a name that stays: /dev/segway-serial (udev rule), or one of: ls -l /dev/serial/by-id",
        )
