# SPDX-License-Identifier: MIT
"""How the guard reads and stops ODrives; what it uses is the same in firmware 0.5 and 0.6."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import COMMANDS, Firmware, Message, decode, encode
from segway_ecc.firmware_io.drives.odrive.messages import AxisState, Heartbeat
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_ANY: Final = Firmware.V0_5


class OdriveStopper:
    """The axes of both wheels; see `Stopper`.

    On is closed loop alone: a drive that calibrates itself is not following commands, and is left in peace.
    """

    drives: Sequence[str] = ("left", "right")
    reports = True

    def __init__(self, settings: OdriveSettings) -> None:
        """Know the axes by their nodes."""
        self._names = {settings.wheel(name).node_id: name for name in self.drives}
        still = (m.SetInputTorque(0.0), m.SetAxisState(AxisState.IDLE))
        self._stop = [encode(_ANY, node_id, message) for node_id in self._names for message in still]

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        name = self._names.get(frame.arbitration_id // COMMANDS)
        if name is None or frame.is_extended or frame.is_remote:
            return None
        try:
            meaning = _meaning(decode(_ANY, frame.arbitration_id, frame.data))
        except FrameRefusedError:
            return None
        return None if meaning is None else Observation(name, meaning)

    def stop(self) -> Sequence[Frame]:
        """Zero torque and idle, for both; see `Stopper.stop`."""
        return self._stop


def _meaning(message: Message) -> Meaning | None:
    match message:
        case m.SetInputTorque(torque):
            return Meaning.MOVE if torque else Meaning.ZERO
        case m.SetAxisState(state):
            return Meaning.DISABLE if state == AxisState.IDLE else Meaning.MOVE
        case m.SetInputPosition() | m.SetInputVelocity():
            return Meaning.MOVE
        case Heartbeat(state=state):
            return Meaning.ON if state == AxisState.CLOSED_LOOP_CONTROL else Meaning.OFF
    return None
