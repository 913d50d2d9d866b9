# SPDX-License-Identifier: MIT
"""The serial port of a simulated ODrive of 0.5: communication/ascii_protocol.cpp, fw-v0.5.6."""

from typing import Final

from segway_ecc.firmware_io.drives.odrive.messages import TORQUE_CONTROL
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._odrive_axis import POSITION_CONTROL, VELOCITY_CONTROL
from segway_ecc.hil.devices._odrive_board import Kind, SimulatedBoard, find

_LONGEST: Final = 256
"""Of a line, bytes."""
_ENDS: Final = b"\r\n!"
_REFUSED: Final = "invalid command format"
_NO_PROPERTY: Final = "invalid property"


class AsciiPort:
    """Reads lines, executes them and writes replies; refuses, in silence, and counts those with a wrong checksum."""

    def __init__(self, port: Port, board: SimulatedBoard) -> None:
        """Serve a board at its end of a line."""
        self.refused = 0
        self._port = port
        self._board = board
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
                return self._write(name, value)
            case ["sc"]:
                self._board.clear_errors()
                return None
            case [verb, *_] if verb in {"c", "v", "p", "u", "f", "r", "w"}:
                return _REFUSED
        return "unknown command"

    def _motion(self, verb: str, number: str, words: list[str], now_ns: int) -> str | None:
        try:
            axis_number, values = int(number), [float(word) for word in words]
        except ValueError:
            return _REFUSED
        if not 0 <= axis_number < len(self._board.axes):
            return f"invalid motor {axis_number}"
        axis = self._board.axes[axis_number]
        if verb == "f":  # the encoder's own estimates, before closed loop too
            return f"{axis.position_rev:f} {axis.velocity_rev_s:f}"
        if verb != "u" and not values:
            return _REFUSED
        # Unlike CAN frames, these change the control mode too.
        match verb, [*values, 0.0, 0.0]:
            case "c", [torque, *_]:
                axis.control_mode = TORQUE_CONTROL
                axis.set_input(torque)
            case "v", [velocity, torque, *_]:
                axis.control_mode = VELOCITY_CONTROL
                axis.set_input(torque, velocity)
            case "p", [position, velocity, torque, *_]:
                axis.control_mode = POSITION_CONTROL
                axis.set_input(torque, velocity, position)
        axis.feed(now_ns)
        return None

    def _read(self, name: str) -> str:
        found = find(self._board, name)
        if found is None:
            return _NO_PROPERTY
        return f"{found.read():f}" if found.entry.kind is Kind.FLOAT else str(int(found.read()))

    def _write(self, name: str, text: str) -> str | None:
        found = find(self._board, name)
        if found is None:
            return _NO_PROPERTY
        try:
            is_written = found.write(found.entry.kind.read_text(text))
        except ValueError:
            is_written = False
        return None if is_written else "not implemented"


def _xor(text: str) -> int:
    total = 0
    for byte in text.encode("latin-1"):
        total ^= byte
    return total
