# SPDX-License-Identifier: MIT
"""What the guard must know of each drive family: what its frames mean to it, and which frames stop the drives."""

import enum
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple, Protocol

from segway_ecc.firmware_io.drives.cia402 import frames as cia402
from segway_ecc.firmware_io.drives.cia402.frames import Controlword, Service
from segway_ecc.firmware_io.drives.cia402.settings import Cia402Settings
from segway_ecc.firmware_io.drives.odrive import frames as odrive
from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.vesc import frames as vesc
from segway_ecc.firmware_io.drives.vesc.frames import PacketId
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.drives.wheel_board import frames as wheel_board
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    BoardSession,
    BoardState,
    BoardStatus,
    FrameId,
    WheelCommand,
)
from segway_ecc.firmware_io.drives.wheel_board.session import CommandReceiver, CommandSession
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame

_ANY_ODRIVE: Final = odrive.Firmware.V0_5
"""What the guard uses is the same in firmware 0.5 and 0.6."""
_CIA402_LENGTH: Final = 4
_CIA402_DISABLE: Final = cia402.TorqueCommand(Controlword.DISABLE_VOLTAGE, 0.0).pack()
_VESC_OTHERS: Final = frozenset(
    command for command in PacketId if command.name.startswith("SET_") and command is not PacketId.SET_CURRENT
)
"""What the node does not send: whoever does wants the motor to do something."""
_BOARD_OFF: Final = WheelCommand(0.0, 0.0, enable=False)
_BOARD_BURST: Final = 2
_ANY_AHEAD: Final = 0x7FFF
"""All that the bits of a counter can say: who looks in on a session knows only those that the board announces."""


@enum.unique
class Meaning(enum.StrEnum):
    """What a frame means to the guard; the first three come from the node, the others from a drive."""

    MOVE = enum.auto()
    """A command that enables, or that carries a torque."""
    ZERO = enum.auto()
    """A command that carries no torque, and leaves the drive as it is."""
    DISABLE = enum.auto()
    """A command that switches the motor off; a zero too, for drives that know no more."""
    ON = enum.auto()
    """The drive reports that its motor follows commands."""
    OFF = enum.auto()
    """The drive reports that it does not."""


class Observation(NamedTuple):
    """What a frame means for a drive."""

    drive: str
    meaning: Meaning


class Stopper(Protocol):
    """A drive family as the guard knows it.

    Its drives are what can be commanded by itself: `board`, or `left` and `right`; `reports` is whether they report if
    they are on.
    """

    drives: Sequence[str]
    reports: bool

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; None for one that is not intact or means nothing to the guard. Never raises."""

    def stop(self) -> Sequence[Frame]:
        """The frames that take the torque from every drive and disable it, of which the first that arrives acts."""


class _WheelStopper:
    """Drives of both wheels, which the same frames stop each time; see `Stopper`."""

    drives: Sequence[str] = ("left", "right")
    reports = True

    def __init__(self, names: Mapping[int, str], stop: Sequence[Frame]) -> None:
        """Know the wheels by a number in their frames, and what stops them."""
        self._names = names
        self._stop = stop

    def stop(self) -> Sequence[Frame]:
        """The frames for both; see `Stopper.stop`."""
        return self._stop


class Cia402Stopper(_WheelStopper):
    """CiA 402 drives: the voltage is taken from both, with zero torque.

    They send their state upon SYNC, which has stopped with the node, so the guard sends one after its commands.
    """

    def __init__(self, settings: Cia402Settings) -> None:
        """Know the drives by their nodes."""
        nodes = {"left": settings.left.node_id, "right": settings.right.node_id}
        commands = {Service.RPDO1 + node: name for name, node in nodes.items()}
        self._statuses = {Service.TPDO1 + node: name for name, node in nodes.items()}
        super().__init__(
            commands, [*(Frame(identifier, _CIA402_DISABLE) for identifier in commands), Frame(Service.SYNC, b"")]
        )

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        if frame.is_extended or frame.is_remote:
            return None
        name = self._names.get(frame.arbitration_id)
        if name is not None:
            if len(frame.data) != _CIA402_LENGTH:
                return None
            enables = frame.data[0] & Controlword.ENABLE_OPERATION == Controlword.ENABLE_OPERATION
            return Observation(name, Meaning.MOVE if enables else Meaning.DISABLE)
        name = self._statuses.get(frame.arbitration_id)
        try:
            state = None if name is None else cia402.state_of(cia402.DriveStatus.unpack(frame.data).statusword)
        except FrameRefusedError:
            return None
        if name is None or state is None:
            return None
        return Observation(name, Meaning.OFF if state in cia402.WITHOUT_TORQUE else Meaning.ON)


class OdriveStopper(_WheelStopper):
    """ODrive axes: zero torque and idle, for both.

    On is closed loop alone: a drive that calibrates itself is not following commands, and is left in peace.
    """

    def __init__(self, settings: OdriveSettings) -> None:
        """Know the axes by their nodes."""
        names = {settings.wheel(name).node_id: name for name in self.drives}
        still = (m.SetInputTorque(0.0), m.SetAxisState(m.AxisState.IDLE))
        super().__init__(
            names, [odrive.encode(_ANY_ODRIVE, node_id, message) for node_id in names for message in still]
        )

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        name = self._names.get(frame.arbitration_id // odrive.COMMANDS)
        if name is None or frame.is_extended or frame.is_remote:
            return None
        try:
            meaning = _odrive_meaning(odrive.decode(_ANY_ODRIVE, frame.arbitration_id, frame.data))
        except FrameRefusedError:
            return None
        return None if meaning is None else Observation(name, meaning)


def _odrive_meaning(message: odrive.Message) -> Meaning | None:
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


class VescStopper(_WheelStopper):
    """VESC controllers: zero current, for both. They know no "off" but that, and report none."""

    reports = False

    def __init__(self, settings: VescSettings) -> None:
        """Know the controllers by their ids."""
        names = {settings.left.controller_id: "left", settings.right.controller_id: "right"}
        still = vesc.Current(0.0)
        super().__init__(names, [vesc.frame_of(PacketId.SET_CURRENT, controller_id, still) for controller_id in names])

    def read(self, frame: Frame) -> Observation | None:
        """What a frame means; see `Stopper.read`."""
        command, controller_id = vesc.addressed(frame) or (None, None)
        name = self._names.get(controller_id) if controller_id is not None else None
        if name is None or frame.is_remote:
            return None
        if command in _VESC_OTHERS:
            return Observation(name, Meaning.MOVE)
        if command is not PacketId.SET_CURRENT:
            return None
        try:
            current = vesc.decode(command, frame.data)[0]
        except FrameRefusedError:
            return None
        return Observation(name, Meaning.MOVE if current else Meaning.DISABLE)


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
        for _ in range(_BOARD_BURST):
            self._counter += 1
            frames.append(
                Frame(FrameId.WHEEL_COMMAND, wheel_board.encode(FrameId.WHEEL_COMMAND, _BOARD_OFF, self._counter))
            )
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
        self._receiver = CommandReceiver(self._session, _ANY_AHEAD)

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
        return [frame for _ in range(_BOARD_BURST) for frame in self._session.command(_BOARD_OFF)]

    def _enter(self, announced: BoardSession) -> None:
        session = self._session
        if not session.is_begun or announced.number != session.number or announced.epoch > session.epoch:
            session.begin(announced.number, announced.epoch)
