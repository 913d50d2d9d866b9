# SPDX-License-Identifier: MIT
"""One axis of a simulated ODrive (its states, errors, watchdog and torque), and the serial port of a board of 0.5."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.odrive.frames import WATCHDOG, Firmware
from segway_ecc.firmware_io.drives.odrive.messages import TORQUE_CONTROL, AxisState
from segway_ecc.firmware_io.drives.odrive.settings import OdriveWheelSettings
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices.device import SUPPLY_VOLTAGE

INVALID_STATE: Final = 0x1
"""Error bit of 0.5."""
PROCEDURE_INVALID_STATE: Final = 13
"""Procedure result of 0.6."""
ESTOP: Final = {Firmware.V0_5: 0x4000, Firmware.V0_6: 0x2000000}
_VELOCITY_CONTROL: Final = 2
_POSITION_CONTROL: Final = 3
_ENTER_NS: Final = 2_000_000
"""From the request until the state is another."""
_TORQUE_CONSTANT: Final = 0.1
_MORE_THAN_ASKED: Final = 1.25
_VELOCITY_GAIN: Final = 0.16
_POSITION_GAIN: Final = 20.0
_LONGEST: Final = 256
"""Of a line, bytes."""
_ENDS: Final = b"\r\n!"
_REFUSED: Final = "invalid command format"


class SimulatedAxis:
    """What the firmware keeps of one axis. The current loop, faster than a tick, is taken as perfect.

    Attributes:
        settings: Gear, direction and torque constant of its wheel.
        state: See `AxisState`.
        error: Bits that are latched until they are cleared.
        procedure_result: How the last request ended; 0.6.
        watchdog_s: Time-out of the watchdog, s; None where it is off.
        current_limit_a: Largest motor current, A.
        velocity_limit_rev_s: Speed beyond which torque mode gives less torque; None where there is no limit.
        counts_per_turn: Of the encoder.
        control_mode: What the input is.
        input_mode: How it is taken: as it is (1), or not at all.
        input_torque_nm: The set-point that is held until another comes.
        velocity_rev_s: Of the motor.
        supply_voltage: Of its board, V.
    """

    def __init__(self, firmware: Firmware, settings: OdriveWheelSettings, watchdog_s: float | None) -> None:
        """Make an axis as it is after power-on."""
        self.firmware = firmware
        self.node_id = settings.node_id
        self.settings = settings
        self.watchdog_s = watchdog_s
        self.torque_constant = settings.torque_constant or _TORQUE_CONSTANT
        largest = abs(settings.motor_torque(settings.max_torque))
        self.current_limit_a = _MORE_THAN_ASKED * largest / self.torque_constant
        self.velocity_limit_rev_s: float | None = None
        self.counts_per_turn = 8192
        self.supply_voltage = SUPPLY_VOLTAGE
        self.restart()

    def restart(self) -> None:
        """Be as after power-on: idle, position mode, counting from here; the watchdog's time begins."""
        self.state = AxisState.IDLE
        self.error = 0
        self.procedure_result = 0
        self.control_mode = _POSITION_CONTROL
        self.input_mode = 1
        self.input_torque_nm = 0.0
        self.input_velocity_rev_s = 0.0
        self.input_position_rev = 0.0
        self.velocity_rev_s = 0.0
        self._turns = 0.0
        self._origin_turns: float | None = None
        self._requested: AxisState | None = None
        self._requested_ns = 0
        self._fed_ns: int | None = None

    @property
    def counts(self) -> int:
        """Encoder counts since power-on."""
        return int((self._turns - (self._origin_turns or 0.0)) * self.counts_per_turn // 1)

    @property
    def position_rev(self) -> float:
        """Turns since power-on, as the encoder resolves them."""
        return self.counts / self.counts_per_turn

    @property
    def torque_nm(self) -> float:
        """Torque of the motor now: nothing unless in closed loop."""
        if self.state is not AxisState.CLOSED_LOOP_CONTROL:
            return 0.0
        limit = self.current_limit_a * self.torque_constant
        return min(max(self._wanted(), -limit), limit)

    @property
    def current_a(self) -> float:
        """Motor current now."""
        return self.torque_nm / self.torque_constant

    @property
    def supply_current_a(self) -> float:
        """What it takes from the supply now, losses not counted."""
        power_w = self.torque_nm * self.velocity_rev_s * TURN
        return power_w / self.supply_voltage if self.supply_voltage else 0.0

    def move(self, angle: float, velocity: float) -> None:
        """Take where the wheel is, rad, and how fast it turns, rad/s."""
        motor = self.settings.motor
        self._turns, self.velocity_rev_s = motor(angle) / TURN, motor(velocity) / TURN
        if self._origin_turns is None:
            self._origin_turns = self._turns

    def feed(self, now_ns: int) -> None:
        """Start the watchdog's time anew."""
        self._fed_ns = now_ns

    def request(self, state: int, now_ns: int) -> None:
        """Ask for a state; a new request takes an earlier complaint about a state back."""
        if self.firmware is Firmware.V0_5:
            self.error &= ~INVALID_STATE
        self._requested = AxisState(state) if state in set(AxisState) else AxisState.UNDEFINED
        self._requested_ns = now_ns

    def set_input(
        self, torque_nm: float, velocity_rev_s: float | None = None, position_rev: float | None = None
    ) -> None:
        """Take a set-point of the motor, which counts only in the mode of the last one given; the others feed forward.

        Args:
            torque_nm: Torque, N m.
            velocity_rev_s: Velocity, rev/s; None leaves it.
            position_rev: Position, rev; None leaves it.
        """
        if self.input_mode:
            self.input_torque_nm = torque_nm
            self.input_velocity_rev_s = self.input_velocity_rev_s if velocity_rev_s is None else velocity_rev_s
            self.input_position_rev = self.input_position_rev if position_rev is None else position_rev

    def set_origin(self, position_rev: float) -> None:
        """Call the present position this."""
        self._origin_turns = self._turns - position_rev

    def latch(self, bits: int) -> None:
        """Raise errors: they stay until cleared, and the motor is off at once."""
        self.error |= bits
        if self.error and self.state is not AxisState.IDLE:
            self.state = AxisState.IDLE

    def tick(self, now_ns: int, *, board_has_errors: bool) -> None:
        """One pass: the watchdog, in whatever state, then what was asked for."""
        if self._fed_ns is None:
            self._fed_ns = now_ns
        if self.watchdog_s is not None and now_ns - self._fed_ns > self.watchdog_s * 1e9:
            self.latch(WATCHDOG[self.firmware])
        if self._requested is not None and now_ns - self._requested_ns >= _ENTER_NS:
            requested, self._requested = self._requested, None
            self._enter(requested, now_ns, refused=board_has_errors or bool(self.error))

    def _enter(self, state: AxisState, now_ns: int, *, refused: bool) -> None:
        if state is AxisState.IDLE:
            self.state, self.procedure_result = state, 0
        elif state is AxisState.CLOSED_LOOP_CONTROL and not refused:
            self.state, self.procedure_result = state, 0
            self.input_position_rev = self.position_rev
            self.feed(now_ns)
        elif self.firmware is Firmware.V0_5:
            self.latch(INVALID_STATE)
        else:
            self.state, self.procedure_result = AxisState.IDLE, PROCEDURE_INVALID_STATE

    def _wanted(self) -> float:
        """The torque that the control mode makes of the input; velocity and position without integrators."""
        velocity = self.velocity_rev_s
        if self.control_mode == TORQUE_CONTROL:
            limit, torque_nm = self.velocity_limit_rev_s, self.input_torque_nm
            if limit is None:
                return torque_nm
            return min(max(torque_nm, _VELOCITY_GAIN * (-limit - velocity)), _VELOCITY_GAIN * (limit - velocity))
        wanted = self.input_velocity_rev_s
        if self.control_mode == _POSITION_CONTROL:
            wanted += _POSITION_GAIN * (self.input_position_rev - self.position_rev)
        elif self.control_mode != _VELOCITY_CONTROL:
            return 0.0
        return _VELOCITY_GAIN * (wanted - velocity) + self.input_torque_nm


_Read = Callable[[SimulatedAxis], str]

_READABLE: Final[Mapping[str, _Read]] = {
    "current_state": lambda axis: str(int(axis.state)),
    "error": lambda axis: str(axis.error),
    "controller.config.control_mode": lambda axis: str(axis.control_mode),
    "controller.config.input_mode": lambda axis: str(axis.input_mode),
    "config.enable_watchdog": lambda axis: str(int(axis.watchdog_s is not None)),
    "config.watchdog_timeout": lambda axis: f"{axis.watchdog_s or 0.0:f}",
    "motor.current_control.Iq_measured": lambda axis: f"{axis.current_a:f}",
}
_READABLE_OF_BOARD: Final[Mapping[str, Callable[[Sequence[SimulatedAxis]], float]]] = {
    "vbus_voltage": lambda axes: axes[0].supply_voltage,
    "ibus": lambda axes: sum(axis.supply_current_a for axis in axes),
}


class AsciiPort:
    """Reads lines, executes them and writes replies; refuses, in silence, and counts those with a wrong checksum."""

    def __init__(self, port: Port, axes: Sequence[SimulatedAxis], clear_errors: Callable[[], None]) -> None:
        """Serve the axes of a board at its end of a line."""
        self.refused = 0
        self._port = port
        self._axes = axes
        self._clear_errors = clear_errors
        self._line = bytearray()
        self._is_too_long = False

    def serve(self, now_ns: int) -> None:
        """Execute what has arrived since the last pass."""
        for byte in self._port.read(self._port.in_waiting):
            if byte in _ENDS:
                if not self._is_too_long:
                    self._serve_line(bytes(self._line), now_ns)
                self._line.clear()
                self._is_too_long = False
            elif len(self._line) < _LONGEST:
                self._line.append(byte)
            else:
                self._is_too_long = True

    def discard(self) -> None:
        """Lose what was received of a line, as when switched off."""
        self._line.clear()
        self._port.read(self._port.in_waiting)

    def _serve_line(self, line: bytes, now_ns: int) -> None:
        text, star, given = line.partition(b";")[0].decode("latin-1").partition("*")
        if star and given.strip() != str(_xor(text)):
            self.refused += 1
            return
        reply = self._obey(text.split(), now_ns)
        if reply is not None:
            end = f"*{_xor(reply)}\r\n" if star else "\r\n"
            self._port.write(f"{reply}{end}".encode("latin-1"))

    def _obey(self, words: list[str], now_ns: int) -> str | None:
        match words:
            case ["c" | "v" | "p" | "u" | "f" as verb, axis, *values]:
                return self._motion(verb, axis, values, now_ns)
            case ["r", name]:
                return self._read(name)
            case ["w", name, value]:
                return self._write(name, value, now_ns)
            case ["sc"]:
                self._clear_errors()
                return None
            case [verb, *_] if verb in {"c", "v", "p", "u", "f", "r", "w"}:
                return _REFUSED
        return "unknown command"

    def _motion(self, verb: str, number: str, words: list[str], now_ns: int) -> str | None:
        try:
            axis_number, values = int(number), [float(word) for word in words]
        except ValueError:
            return _REFUSED
        if not 0 <= axis_number < len(self._axes):
            return f"invalid motor {axis_number}"
        axis = self._axes[axis_number]
        if verb == "f":
            return f"{axis.position_rev:f} {axis.velocity_rev_s:f}"
        if verb != "u" and not values:
            return _REFUSED
        # Unlike CAN frames, these change the control mode too.
        match verb, [*values, 0.0, 0.0]:
            case "c", [torque, *_]:
                axis.control_mode = TORQUE_CONTROL
                axis.set_input(torque)
            case "v", [velocity, torque, *_]:
                axis.control_mode = 2
                axis.set_input(torque, velocity)
            case "p", [position, velocity, torque, *_]:
                axis.control_mode = 3
                axis.set_input(torque, velocity, position)
        axis.feed(now_ns)
        return None

    def _read(self, name: str) -> str:
        if name in _READABLE_OF_BOARD:
            return f"{_READABLE_OF_BOARD[name](self._axes):f}"
        axis, key = self._find(name)
        reader = _READABLE.get(key)
        return "invalid property" if axis is None or reader is None else reader(axis)

    def _write(self, name: str, value: str, now_ns: int) -> str | None:
        axis, key = self._find(name)
        if axis is None or not value.isdecimal():
            return "invalid property" if axis is None else "not implemented"
        match key:
            case "requested_state":
                axis.request(int(value), now_ns)
            case "controller.config.control_mode":
                axis.control_mode = int(value)
            case "controller.config.input_mode":
                axis.input_mode = int(value)
            case _:
                return "invalid property"
        return None

    def _find(self, name: str) -> tuple[SimulatedAxis | None, str]:
        root, _, key = name.partition(".")
        names = [f"axis{index}" for index in range(len(self._axes))]
        return (self._axes[names.index(root)] if root in names else None), key


def _xor(text: str) -> int:
    total = 0
    for byte in text.encode("latin-1"):
        total ^= byte
    return total
