# SPDX-License-Identifier: MIT
"""What the guard must know of ODrives."""

from typing import Final

from segway_ecc.firmware_io.drives.odrive import frames as odrive
from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, WheelStopper
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_ANY_FIRMWARE: Final = odrive.Firmware.V0_5
"""What the guard uses is the same in firmware 0.5 and 0.6."""


class OdriveStopper(WheelStopper):
    """ODrive axes: zero torque and idle, for each.

    On is closed loop alone: a drive that calibrates itself is not following commands, and is left in peace.
    """

    def __init__(self, settings: OdriveSettings) -> None:
        """Know the axes by their nodes."""
        names = {wheel.node_id: name for name, wheel in settings.axes.items()}
        still = (m.SetInputTorque(0.0), m.SetAxisState(m.AxisState.IDLE))
        super().__init__(
            names, [odrive.encode(_ANY_FIRMWARE, node_id, message) for node_id in names for message in still]
        )

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        name = self._names.get(frame.arbitration_id // odrive.COMMANDS)
        if name is None or frame.is_extended or frame.is_remote:
            return None
        try:
            meaning = _meaning(odrive.decode(_ANY_FIRMWARE, frame.arbitration_id, frame.data))
        except FrameRefusedError:
            return None
        return None if meaning is None else Observation(name, meaning)


def _meaning(message: odrive.Message) -> Meaning | None:
    match message:
        case m.SetInputTorque(torque):
            return Meaning.MOVE if torque else Meaning.ZERO
        case m.SetAxisState(state):
            return Meaning.DISABLE if state == m.AxisState.IDLE else Meaning.MOVE
        case m.SetInputPosition() | m.SetInputVelocity():
            return Meaning.MOVE
        case m.Heartbeat(state=state):
            return Meaning.ON if state == m.AxisState.CLOSED_LOOP_CONTROL else Meaning.OFF
    return None
