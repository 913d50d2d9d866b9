# SPDX-License-Identifier: MIT
"""What the guard must know of the board of a hoverboard."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.hoverboard.frames import COMMAND, command_frame
from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.links.link import Frame

_STOP: Final = command_frame(0, 0)


class HoverboardStopper:
    """The board: zero for both motors, for it knows no "off" and reports none; see `Stopper`."""

    drives: Sequence[str] = ("board",)
    reports = False

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.arbitration_id != COMMAND or frame.is_extended or len(frame.data) != len(_STOP.data):
            return None
        return Observation("board", Meaning.MOVE if any(frame.data) else Meaning.DISABLE)

    def stop(self) -> Sequence[Frame]:
        """The frame for both; see `Stopper.stop`."""
        return (_STOP,)
