"""The drives' own watchdogs, as the robot file has them."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, good, warning
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.firmware_io.build import HardwareSettings
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings

_CYCLES: Final = 3


def check_drives(_machine: System, workload: Workload) -> Iterator[Finding]:
    """How long a drive goes on by itself, how that is made sure, and whether it bears a late cycle."""
    if workload.hardware is None:
        yield good("drives' watchdogs", "no drives" if workload.robot is not None else "no robot is named")
        return
    seconds, how = _watchdog(workload.hardware)
    period_s = workload.period_ns * 1e-9
    found = f"{seconds * 1e3:g} ms, {how}"
    if seconds >= _CYCLES * period_s:
        yield good("drives' watchdogs", found)
    else:
        yield warning(
            "drives' watchdogs",
            f"{found}; the loop's period is {period_s * 1e3:g} ms",
            f"fewer than {_CYCLES} cycles: one that is late or lost may switch the motors off",
            "a longer hardware.watchdog_s in the robot file (VESC: timeout_set_s, and VESC Tool), or a faster model",
        )


def _watchdog(hardware: HardwareSettings) -> tuple[float, str]:
    match hardware:
        case WheelBoardSettings():
            return hardware.watchdog_s, "set by the node, and read back before it arms"
        case OdriveSettings():
            return hardware.watchdog_s, "set with odrivetool; the node has each axis prove it before it arms"
        case VescSettings():
            return hardware.timeout_set_s, "set with VESC Tool; the node measures it before it arms"
        case Cia402Settings():
            return hardware.watchdog_s, "a heartbeat time that the node sets, and reads back before it arms"
