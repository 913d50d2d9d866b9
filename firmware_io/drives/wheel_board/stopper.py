# SPDX-License-Identifier: MIT
"""What the guard must know of a wheel board."""

from collections.abc import Sequence
from typing import Final

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.drives.wheel_board import frames as wheel_board
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSession,
    BoardState,
    BoardStatus,
    FrameId,
    WheelCommand,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CARRIED, CommandReceiver, CommandSession
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


class SessionBoardStopper:
    """A wheel board of version 2; see `Stopper`. It takes the session from the board, and the counter from the node.

    The board takes no count twice: stop frames go on from the node's last command, and overtake a node that goes on
    too. They come twice, as should a command of the node have been missed the first would be refused.
    """

    drives: Sequence[str] = ("board",)
    reports = True

    def __init__(self) -> None:
        """Know nothing of the session."""
        self._session = CommandSession()
        # Who looks in on a session knows only the counter that the board announces, so any may follow it.
        self._receiver = CommandReceiver(self._session, CARRIED)

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.is_extended or frame.arbitration_id not in (FrameId.BOARD_STATUS, FrameId.BOARD_SESSION):
            match self._receiver.check(frame):
                case WheelCommand(enable=enables):
                    return Observation("board", Meaning.MOVE if enables else Meaning.DISABLE)
            return None
        try:
            payload, _ = wheel_board.decode(frame.arbitration_id, frame.data)
        except FrameRefusedError:
            return None
        if isinstance(payload, BoardSession):
            self._enter(payload)
        if isinstance(payload, BoardStatus):
            return Observation("board", Meaning.ON if payload.state is BoardState.ENABLED else Meaning.OFF)
        return None

    def stop(self) -> Sequence[Frame]:
        """Zero with the motors off, twice; see `Stopper.stop`. None before the board has announced its session."""
        if not self._session.is_begun:
            return ()
        return [frame for _ in range(_BURST) for frame in self._session.command(_OFF)]

    def _enter(self, announced: BoardSession) -> None:
        session = self._session
        if not session.is_begun or announced.number != session.number or announced.epoch > session.epoch:
            session.begin(announced.number, announced.epoch)
