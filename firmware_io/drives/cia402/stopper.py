# SPDX-License-Identifier: MIT
"""What the guard must know of CiA 402 drives."""

from typing import Final

from segway_ecc.firmware_io.drives.cia402 import frames as cia402
from segway_ecc.firmware_io.drives.cia402.frames import Controlword, Service
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, WheelStopper
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_LENGTH: Final = 4
_DISABLE: Final = cia402.TorqueCommand(Controlword.DISABLE_VOLTAGE, 0.0).pack()


class Cia402Stopper(WheelStopper):
    """CiA 402 drives: the voltage is taken from all, with zero torque.

    They send their state upon SYNC, which has stopped with the node, so the guard sends one after its commands.
    """

    def __init__(self, settings: Cia402Settings) -> None:
        """Know the drives by their nodes."""
        commands = {Service.RPDO1 + wheel.node_id: name for name, wheel in settings.axes.items()}
        self._statuses = {Service.TPDO1 + wheel.node_id: name for name, wheel in settings.axes.items()}
        super().__init__(
            commands, [*(Frame(identifier, _DISABLE) for identifier in commands), Frame(Service.SYNC, b"")]
        )

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.is_extended or frame.is_remote:
            return None
        name = self._names.get(frame.arbitration_id)
        if name is not None:
            if len(frame.data) != _LENGTH:
                return None
            enables = frame.data[0] & Controlword.ENABLE_OPERATION == Controlword.ENABLE_OPERATION
            return Observation(name, Meaning.MOVE if enables else Meaning.DISABLE)
        drive = self._statuses.get(frame.arbitration_id)
        return None if drive is None else _read_status(drive, frame)


def _read_status(drive: str, frame: Frame) -> Observation | None:
    try:
        state = cia402.state_of(cia402.DriveStatus.unpack(frame.data).statusword)
    except FrameRefusedError:
        return None
    return None if state is None else Observation(drive, Meaning.OFF if state in cia402.WITHOUT_TORQUE else Meaning.ON)
