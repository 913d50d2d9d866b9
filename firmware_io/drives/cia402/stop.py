# SPDX-License-Identifier: MIT
"""How the guard reads and stops CiA 402 drives."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.cia402.frames import (
    WITHOUT_TORQUE,
    Controlword,
    DriveStatus,
    Service,
    TorqueCommand,
    state_of,
)
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_LENGTH: Final = 4
_DISABLE: Final = TorqueCommand(Controlword.DISABLE_VOLTAGE, 0.0).pack()


class Cia402Stopper:
    """The drives of both wheels; see `Stopper`.

    They send their state upon SYNC, which has stopped with the node, so the guard sends one after its commands.
    """

    drives: Sequence[str] = ("left", "right")
    reports = True

    def __init__(self, settings: Cia402Settings) -> None:
        """Know the drives by their nodes."""
        nodes = {"left": settings.left.node_id, "right": settings.right.node_id}
        self._commands = {Service.RPDO1 + node: name for name, node in nodes.items()}
        self._statuses = {Service.TPDO1 + node: name for name, node in nodes.items()}
        self._stop = [*(Frame(identifier, _DISABLE) for identifier in self._commands), Frame(Service.SYNC, b"")]

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.is_extended or frame.is_remote:
            return None
        name = self._commands.get(frame.arbitration_id)
        if name is not None:
            if len(frame.data) != _LENGTH:
                return None
            enables = frame.data[0] & Controlword.ENABLE_OPERATION == Controlword.ENABLE_OPERATION
            return Observation(name, Meaning.MOVE if enables else Meaning.DISABLE)
        name = self._statuses.get(frame.arbitration_id)
        try:
            state = None if name is None else state_of(DriveStatus.unpack(frame.data).statusword)
        except FrameRefusedError:
            return None
        if name is None or state is None:
            return None
        return Observation(name, Meaning.OFF if state in WITHOUT_TORQUE else Meaning.ON)

    def stop(self) -> Sequence[Frame]:
        """The voltage taken from both, zero torque, and SYNC; see `Stopper.stop`."""
        return self._stop
