# SPDX-License-Identifier: MIT
"""A wheel board as its firmware behaves; docs/drives/wheel_board.md is the same for firmware authors."""

from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Final

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    CYCLE_TIME_S,
    MAX_ACCELERATION,
    MAX_ANGLE,
    MAX_BUS_VOLTAGE,
    MAX_TURN_RATE,
    MAX_VELOCITY,
    AngularVelocity,
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    Endpoint,
    FrameId,
    LinearAcceleration,
    Payload,
    Wheel,
    WheelCommand,
)
from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec
from segway_ecc.firmware_io.drives.wheel_board.session import SESSION_SILENT_S, CommandReceiver, CommandSession
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import LOST, Port
from segway_ecc.hil.devices.device import supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

TICK_NS: Final = 5_000_000
"""Period of the firmware's loop, and of the wheel and IMU frames."""
_DEFAULT_WATCHDOG_S: Final = 0.05
_STATUS_TICKS: Final = round(CYCLE_TIME_S[FrameId.BOARD_STATUS] * 1e9 / TICK_NS)
_OFF: Final[Sequence[float]] = (0.0, 0.0)
_COMMANDS: Final = frozenset({FrameId.WHEEL_COMMAND, FrameId.BOARD_SETUP})
_WHEELS: Final = ("left.angle", "left.velocity", "right.angle", "right.velocity")
_GYRO: Final = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
_ACCELERATION: Final = tuple(f"imu.linear_acceleration_{axis}" for axis in "xyz")
_wheels: Final = itemgetter(*_WHEELS)
_gyro: Final = itemgetter(*_GYRO)
_acceleration: Final = itemgetter(*_ACCELERATION)
_DEFAULTS: Final = WheelBoardSettings()
_FIRST_SESSION: Final = 1
_SESSIONS: Final = 1 << 32


class SimulatedWheelBoard:
    """Takes commands, runs its watchdog and sends telemetry; see `Device`.

    Each line has its own counters. The owner is the line over which a command that does not enable came last; commands
    that enable are taken from the owner alone. So torque never comes from two lines, either one can always stop it, and
    a board that was just switched on does nothing before it was commanded to be off. In version 2 both lines share a
    session; its number is the board's count of sessions, as one would keep it in flash.

    Its motors are given `voltages`, V; set `is_broken` to have it find a fault, clear it to have the cause gone, and
    clear `has_watchdog` to have it report its watchdog and never act on it.
    """

    inputs: Sequence[str] = ("left.voltage", "right.voltage")

    def __init__(self, link: Link, settings: WheelBoardSettings = _DEFAULTS, port: Port | None = None) -> None:
        """Switch a board on, which sends over `link` and answers at `port`, its end of a serial line."""
        self.needs: Sequence[str] = (*_WHEELS, *_GYRO, *_ACCELERATION) if settings.imu else _WHEELS
        self.state = BoardState.DISABLED
        self.voltages: Sequence[float] = _OFF
        self.is_broken = False
        self.has_watchdog = True
        self._has_imu = settings.imu
        self._session: CommandSession | None = None
        if settings.protocol == 2:  # noqa: PLR2004 - the version
            self._session = CommandSession()
            self._session.begin(_FIRST_SESSION)
        self._bus = _Line(link.send, self._session)
        self._serial = None if port is None else _SerialEnd(port, self._session)
        self._owner: _Line | None = None
        self._strange_commands = 0
        self._watchdog_s = _DEFAULT_WATCHDOG_S
        self._last_command_ns = 0
        self._commanded_ns = 0
        self._sent_state = self.state
        self._ticks = 0

    @property
    def refused_frames(self) -> int:
        """Frames refused since power-on, on both lines; commands that enable from a line that may not among them."""
        refused = self._bus.refused_frames + self._strange_commands
        return refused if self._serial is None else refused + self._serial.refused_frames

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process commands, answer requests on the serial line and run the watchdog; see `Device.obey`."""
        for frame in frames:
            self._receive(self._bus, frame, now_ns)
        if self._serial is not None:
            received, is_asked = self._serial.receive(now_ns)
            for frame in received:
                self._receive(self._serial.line, frame, now_ns)
            if is_asked:
                self._send_measured(self._serial.line.endpoint, outputs)
                self._send_status(self._serial.line.endpoint, outputs)
        if self.is_broken:
            self._switch_off(BoardState.FAULT)
        is_late = now_ns - self._last_command_ns > self._watchdog_s * 1e9
        if self.has_watchdog and self.state is BoardState.ENABLED and is_late:
            self._switch_off(BoardState.WATCHDOG)
        if self._session is not None:
            self._renew(self._session, now_ns)
        return self.voltages

    def send_telemetry(self, _now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send what is measured each time, and the status now and then and whenever the state changes."""
        self._send_measured(self._bus.endpoint, outputs)
        if self._ticks % _STATUS_TICKS == 0 or self.state is not self._sent_state:
            self._send_status(self._bus.endpoint, outputs)
            self._sent_state = self.state
        self._ticks += 1

    def _receive(self, line: "_Line", frame: Frame, now_ns: int) -> None:
        payload = line.check(frame)
        if payload is None:  # as most of what a full bus carries
            return
        if isinstance(payload, WheelCommand):
            self._commanded_ns = now_ns
        match payload:
            case WheelCommand(enable=False):
                self._owner = line
                self._switch_off(BoardState.DISABLED)
            case WheelCommand() if line is not self._owner:
                self._strange_commands += 1
            case WheelCommand(left, right) if self.state in (BoardState.DISABLED, BoardState.ENABLED):
                self.state = BoardState.ENABLED
                self.voltages = (left, right)
                self._last_command_ns = now_ns
            case BoardSetup(watchdog_s) if self.state is not BoardState.ENABLED:
                self._watchdog_s = watchdog_s

    def _switch_off(self, state: BoardState) -> None:
        self.state = state
        self.voltages = _OFF

    def _renew(self, session: CommandSession, now_ns: int) -> None:
        """Begin a new session where that of now was used, and its host has fallen silent or lost count."""
        is_silent = now_ns - self._commanded_ns > SESSION_SILENT_S * 1e9
        if session.counter and is_silent and self.state is not BoardState.ENABLED:
            session.begin((session.number + 1) % _SESSIONS)

    def _send_status(self, line: Endpoint, outputs: Mapping[str, float]) -> None:
        line.send(FrameId.BOARD_STATUS, self._status(outputs))
        session = self._session
        if session is not None:
            line.send(FrameId.BOARD_SESSION, BoardSession(session.number, session.epoch))

    def _status(self, outputs: Mapping[str, float]) -> BoardStatus:
        volts = min(max(supply_voltage(outputs), 0.0), MAX_BUS_VOLTAGE)
        return BoardStatus(self.state, volts, self._watchdog_s, self.refused_frames)

    def _send_measured(self, line: Endpoint, outputs: Mapping[str, float]) -> None:
        """Send what the board measures over a line; its counters stop at the ends of their range."""
        left_angle, left_velocity, right_angle, right_velocity = _wheels(outputs)
        line.send(FrameId.LEFT_WHEEL, _wheel(left_angle, left_velocity))
        line.send(FrameId.RIGHT_WHEEL, _wheel(right_angle, right_velocity))
        if self._has_imu:
            line.send(FrameId.IMU_GYRO, AngularVelocity(*_axes(_gyro(outputs), MAX_TURN_RATE)))
            line.send(FrameId.IMU_ACCELERATION, LinearAcceleration(*_axes(_acceleration(outputs), MAX_ACCELERATION)))


class _Line:
    """One of the lines to the host: telemetry goes there, and commands come, of the version that the board has."""

    def __init__(self, send: Callable[[Frame], bool], session: CommandSession | None) -> None:
        self.endpoint = Endpoint(send, _COMMANDS)
        self._commands = None if session is None else CommandReceiver(session)

    @property
    def refused_frames(self) -> int:
        """Frames that were refused."""
        return (self.endpoint if self._commands is None else self._commands).refused.total()

    def check(self, frame: Frame) -> Payload | None:
        """What a frame commands; see `Endpoint.check`."""
        return self.endpoint.check(frame) if self._commands is None else self._commands.check(frame)


class _SerialEnd:
    """The board's end of its serial line."""

    def __init__(self, port: Port, session: CommandSession | None) -> None:
        self.line = _Line(self.send, session)
        self._codec = BoardSerialCodec()
        self._port = port

    @property
    def refused_frames(self) -> int:
        """Packets and frames refused on this line; what was lost on the way is not refused."""
        return self.line.refused_frames + self._codec.refused.total() - self._codec.refused[LOST]

    def send(self, frame: Frame) -> bool:
        """Write a frame as a packet; nothing drops it."""
        self._port.write(self._codec.encode(frame) or b"")  # there are words for each of our frames
        return True

    def receive(self, now_ns: int) -> tuple[list[Frame], bool]:
        """The frames that have arrived, and whether telemetry was asked for."""
        requests = self._codec.requests
        frames = self._codec.decode(self._port.read(self._port.in_waiting), now_ns)
        return frames, self._codec.requests > requests


def _wheel(angle: float, velocity: float) -> Wheel:
    return Wheel(_within(angle, MAX_ANGLE), _within(velocity, MAX_VELOCITY))


def _axes(values: Sequence[float], limit: float) -> Sequence[float]:
    x, y, z = values
    if -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit:
        return values
    return [_within(value, limit) for value in values]


def _within(value: float, limit: float) -> float:
    return value if -limit <= value <= limit else min(max(value, -limit), limit)


def _press_stop(board: SimulatedWheelBoard, pressed: bool) -> None:  # noqa: FBT001 - as the rig calls it
    board.is_broken = pressed  # the enable input


def _lose_watchdog(board: SimulatedWheelBoard) -> None:
    board.has_watchdog = False


def _fail(board: SimulatedWheelBoard) -> None:
    board.is_broken = True


SIMULATED: Final[SimulatedDrives[WheelBoardSettings, SimulatedWheelBoard]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, port: SimulatedWheelBoard(link, settings, port),
    press_stop=_press_stop,
    lose_watchdog=_lose_watchdog,
    fail=_fail,
)
