# SPDX-License-Identifier: MIT
"""What the guard must know of VESC controllers."""

from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation, WheelStopper
from segway_ecc.firmware_io.drives.vesc import frames as vesc
from segway_ecc.firmware_io.drives.vesc.frames import PacketId
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_OTHERS: Final = frozenset(
    command for command in PacketId if command.name.startswith("SET_") and command is not PacketId.SET_CURRENT
)
"""What the node does not send: whoever does wants the motor to do something."""


class VescStopper(WheelStopper):
    """VESC controllers: zero current, for each. They know no "off" but that, and report none."""

    reports = False

    def __init__(self, settings: VescSettings) -> None:
        """Know the controllers by their ids."""
        names = {wheel.controller_id: name for name, wheel in settings.axes.items()}
        still = vesc.Current(0.0)
        super().__init__(names, [vesc.frame_of(PacketId.SET_CURRENT, controller_id, still) for controller_id in names])

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        addressed = vesc.addressed(frame)
        if addressed is None or frame.is_remote:
            return None
        command, controller_id = addressed
        name = self._names.get(controller_id)
        if name is None:
            return None
        if command in _OTHERS:
            return Observation(name, Meaning.MOVE)
        if command is not PacketId.SET_CURRENT:
            return None
        try:
            current = vesc.decode(command, frame.data)[0]
        except FrameRefusedError:
            return None
        return Observation(name, Meaning.MOVE if current else Meaning.DISABLE)
