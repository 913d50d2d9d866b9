# SPDX-License-Identifier: MIT
"""The serial port of a simulated ODrive board with firmware 0.5: the ASCII protocol."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.drives.odrive.messages import TORQUE_CONTROL
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._odrive_axis import SimulatedAxis

_LONGEST: Final = 256
_ENDS: Final = b"\r\n!"
_REFUSED: Final = "invalid command format"
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
    """Reads lines, executes them and writes replies.

    Attributes:
        refused: Lines with a wrong checksum, which the firmware passes over in silence.
    """

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
