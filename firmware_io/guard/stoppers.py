"""The guard's part of each drive family."""

from segway_ecc.firmware_io.build import HardwareSettings
from segway_ecc.firmware_io.drives.cia402.stop import Cia402Stopper
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.odrive.stop import OdriveStopper
from segway_ecc.firmware_io.drives.stopper import Stopper
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.vesc.stop import VescStopper
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.drives.wheel_board.stop import WheelBoardStopper


def stopper_of(settings: HardwareSettings) -> Stopper:
    """What reads and stops the drives that a robot file describes."""
    match settings:
        case WheelBoardSettings():
            return WheelBoardStopper()
        case OdriveSettings():
            return OdriveStopper(settings)
        case VescSettings():
            return VescStopper(settings)
    return Cia402Stopper(settings)
