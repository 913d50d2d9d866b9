# SPDX-License-Identifier: MIT
"""What the guard must know of a wheel board."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.drives.wheel_board import frames as wheel_board
from segway_ecc.firmware_io.drives.wheel_board.frames import BoardState, BoardStatus, FrameId, WheelCommand
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_OFF: Final = WheelCommand(0.0, 0.0, enable=False)
_BURST: Final = 2


class WheelBoardStopper:
    """A wheel board; see `Stopper`.

    The board takes a command whose counter follows that of the last one, and a counter that does not becomes the new
    reference (`CounterCheck`). So stop frames go on counting from the node's last command, and come in pairs: should
    the first be refused, because a command of the node was missed, the second is taken.
    """

    drives: Sequence[str] = ("board",)
    reports = True

    def __init__(self) -> None:
        """Know nothing of the node's counter."""
        self._counter = 0

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.is_extended or frame.arbitration_id not in (FrameId.WHEEL_COMMAND, FrameId.BOARD_STATUS):
            return None
        try:
            payload, counter = wheel_board.decode(frame.arbitration_id, frame.data)
        except FrameRefusedError:
            return None
        if isinstance(payload, BoardStatus):
            return Observation("board", Meaning.ON if payload.state is BoardState.ENABLED else Meaning.OFF)
        self._counter = counter
        enables = isinstance(payload, WheelCommand) and payload.enable
        return Observation("board", Meaning.MOVE if enables else Meaning.DISABLE)

    def stop(self) -> Sequence[Frame]:
        """Zero with the motors off, twice; see `Stopper.stop`."""
        frames = []
        for _ in range(_BURST):
            self._counter += 1
            frames.append(Frame(FrameId.WHEEL_COMMAND, wheel_board.encode(FrameId.WHEEL_COMMAND, _OFF, self._counter)))
        return frames
