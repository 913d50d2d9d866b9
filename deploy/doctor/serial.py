"""The serial line that the robot falls back on."""

import errno
import re
from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, bad, good, warning
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.firmware_io.build import serial_of
from segway_ecc.firmware_io.links.serial_port import open_remedy

_NUMBERED_AS_FOUND: Final = re.compile(r"/dev/tty(USB|ACM)\d+")
_TAKEN: Final = (errno.EAGAIN, errno.EBUSY)


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
