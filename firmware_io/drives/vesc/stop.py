# SPDX-License-Identifier: MIT
"""How the guard reads and stops VESC controllers."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.drives.vesc.frames import Current, PacketId, addressed, decode, frame_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_OTHERS: Final = frozenset(
    command for command in PacketId if command.name.startswith("SET_") and command is not PacketId.SET_CURRENT
)
"""What the node does not send: whoever does wants the motor to do something."""


class VescStopper:
    """The controllers of both wheels; see `Stopper`. They know no "off" but zero current, and report none."""

    drives: Sequence[str] = ("left", "right")
    reports = False

    def __init__(self, settings: VescSettings) -> None:
        """Know the controllers by their ids."""
        self._names = {settings.left.controller_id: "left", settings.right.controller_id: "right"}
        self._stop = [frame_of(PacketId.SET_CURRENT, controller_id, Current(0.0)) for controller_id in self._names]

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        command, controller_id = addressed(frame) or (None, None)
        name = self._names.get(controller_id) if controller_id is not None else None
        if name is None or frame.is_remote:
            return None
        if command in _OTHERS:
            return Observation(name, Meaning.MOVE)
        if command is not PacketId.SET_CURRENT:
            return None
        try:
            current = decode(command, frame.data)[0]
        except FrameRefusedError:
            return None
        return Observation(name, Meaning.MOVE if current else Meaning.DISABLE)

    def stop(self) -> Sequence[Frame]:
        """Zero current, for both; see `Stopper.stop`."""
        return self._stop
