"""The drives' own watchdogs, as the robot file has them."""

from collections.abc import Iterator
from typing import Final

from segway_ecc.deploy.doctor.finding import Finding, good, graded
from segway_ecc.deploy.doctor.system import System, Workload
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings

_CYCLES: Final = 3


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
