# SPDX-License-Identifier: MIT
"""moteus controllers as their firmware behaves.

Read in 2026 (register map 5): moteus_controller.cc, bldc_servo_structs.h, bldc_servo_control.h and fdcan_micro_server.h
in fw of github.com/mjbots/moteus; multiplex/micro_server.cc and micro/persistent_config.cc of github.com/mjbots/mjlib.
Simplified: torque follows at once, positions have no limits of speed, other modes give no torque, registers from 0x080
on are not there, and an answer is cut off where its frame is full.
"""

import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.moteus.settings import MoteusAxisSettings, MoteusSettings
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame, Link
from segway_ecc.hil.devices.device import SUPPLY_VOLTAGE, supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

TICK_NS: Final = 1_000_000
_TICKS_TO_ENABLE: Final = 10  # one for the power stage, then 256 samples of the currents at 30 kHz (kCalibrateCount)
_STOPPED, _FAULT, _ENABLING, _CALIBRATING, _POSITION, _TIMEOUT, _ZERO_VELOCITY = 0, 1, 2, 3, 10, 11, 12
_COMMANDED: Final = (_STOPPED, *range(5, 16))  # any other mode is ignored
_DRIVER, _OVER_VOLTAGE, _OUTSIDE_LIMIT, _UNDER_VOLTAGE = 33, 34, 39, 40
_KP, _KD, _VOLTAGES, _WARMTH = 4.0, 0.05, (4.0, 46.0), 30.0
_SCALES: Final = {  # by register, the worth of a step as int8, int16, int32 and float
    **dict.fromkeys((0x00, 0x0F), (1.0, 1.0, 1.0, 1.0)),
    **dict.fromkeys((0x01, 0x20), (1e-2, 1e-4, 1e-5, 1.0)),
    **dict.fromkeys((0x02, 0x21), (0.1, 2.5e-4, 1e-5, 1.0)),
    **dict.fromkeys((0x03, 0x22, 0x25), (0.5, 1e-2, 1e-3, 1.0)),
    **dict.fromkeys((0x0D,), (0.5, 0.1, 1e-3, 1.0)),
    **dict.fromkeys((0x0E,), (1.0, 0.1, 1e-3, 1.0)),
    **dict.fromkeys((0x23, 0x24), (1 / 127, 1 / 32767, 1 / 2147483647, 1.0)),
    **dict.fromkeys((0x27,), (1e-2, 1e-3, 1e-6, 1.0)),
}
_READ, _END, _TEXT, _POLL, _NOP = 0x10, 0x20, 0x40, 0x42, 0x50  # sub-frames: those that read, up to the end; others
_FORMS: Final = tuple(map(struct.Struct, ("<b", "<h", "<i", "<f")))
_FLOAT, _FIRST_ABSENT = 3, 0x80
# The registers of a command, as writing the mode leaves them:
_MODE_WRITTEN: Final = {0x20: 0.0, 0x21: 0.0, 0x22: 0.0, 0x23: 1.0, 0x24: 1.0, 0x25: 100.0, 0x27: 0.0}
_SET_UP: Final = {  # as the manual page has it
    "servo.timeout_mode": 0.0,
    "servo.default_timeout_s": 0.1,
    "servo.pid_position.ilimit": 0.0,
    "servo.inertia_feedforward": 0.0,
    "servopos.position_min": math.nan,
    "servopos.position_max": math.nan,
}


class Controller:
    """One controller with its motor: turns, turns/s, N m at its shaft, V. Its `configuration` may be written to."""

    def __init__(self, settings: MoteusAxisSettings) -> None:
        """Switch it on."""
        self.settings, self.configuration = settings, dict(_SET_UP)
        self.mode = self.fault = self._wanted = self._ticks = 0
        self.position = self.velocity = self.torque = self._timeout_s = 0.0
        self.voltage, self._held, self._is_new = SUPPLY_VOLTAGE, math.nan, False
        self._command, self._console = dict(_MODE_WRITTEN), b""

    def receive(self, data: bytes) -> bytes:
        """Process sub-frames, up to one that is unknown or malformed; returns those of the answer."""
        answer, stream = b"", iter(data)
        try:
            for head in stream:
                if head in (_TEXT, _POLL):
                    answer += self._exchange_text(head, stream)
                elif head < _END:
                    count, first = head & 3 or next(stream), next(stream)
                    if first >= _FIRST_ABSENT:
                        break
                    answer += (self._write if head < _READ else self._read)(head, first, count, stream)
                elif head != _NOP:
                    break
        except (StopIteration, struct.error):
            pass  # what came before it counts
        if self._wanted == _STOPPED:  # as it is before the next frame can be there
            self.mode, self.fault, self._ticks = _STOPPED, 0, 0
        return answer[: FD_LENGTHS[-1]]

    def run(self) -> float:
        """A millisecond of its loop; returns the torque."""
        if self._is_new:
            self._is_new, self._timeout_s = False, self._command[0x27] or self.configuration["servo.default_timeout_s"]
        elif self._timeout_s > 0.0:
            self._timeout_s = max(0.0, self._timeout_s - TICK_NS * 1e-9)
        self._change_mode()
        if self.mode > _FAULT and not _VOLTAGES[0] <= self.voltage <= _VOLTAGES[1]:
            self.fail(_UNDER_VOLTAGE if self.voltage < _VOLTAGES[0] else _OVER_VOLTAGE)
        if self.mode == _POSITION and self._timeout_s <= 0.0:
            self.mode = _TIMEOUT
        self.torque = self._applied_torque()
        return self.torque

    def fail(self, code: int) -> None:
        """End in a fault, which a stop clears."""
        self.mode, self.fault = _FAULT, code

    def _change_mode(self) -> None:
        if self._wanted == _STOPPED:
            return
        least, most = (self.configuration[f"servopos.position_{end}"] for end in ("min", "max"))
        if self.mode in (_STOPPED, _ENABLING, _CALIBRATING) and self._ticks < _TICKS_TO_ENABLE:
            self.mode, self._ticks = _CALIBRATING if self._ticks else _ENABLING, self._ticks + 1
        elif self.mode not in (_FAULT, _TIMEOUT, self._wanted):
            self.mode, self._held = self._wanted, math.nan
            if self.mode == _POSITION and (self.position < least or self.position > most):
                self.fail(_OUTSIDE_LIMIT)

    def _applied_torque(self) -> float:
        mode, command = self.mode, self._command
        if mode == _TIMEOUT:
            mode, command = int(self.configuration["servo.timeout_mode"]), _MODE_WRITTEN | {0x20: math.nan}
        if mode not in (_POSITION, _ZERO_VELOCITY):
            return 0.0
        if math.isnan(self._held) or not math.isnan(command[0x20]):
            self._held = self.position if math.isnan(command[0x20]) else command[0x20]
        stiffness = _KP * command[0x23] if mode == _POSITION else 0.0
        torque = stiffness * (self._held - self.position) + _KD * command[0x24] * (command[0x21] - self.velocity)
        torque, most = torque + command[0x22], command[0x25]
        limited = torque if math.isnan(most) else min(max(torque, -most), most)
        return limited if math.isfinite(limited) else 0.0

    def _write(self, head: int, first: int, count: int, stream: Iterator[int]) -> bytes:
        answer, kind, form = b"", head >> 2, _FORMS[head >> 2]
        for register in range(first, first + count):
            (raw,) = form.unpack(bytes(islice(stream, form.size)))
            if register == 0 and raw in _COMMANDED:
                self._command, self._wanted, self._is_new = dict(_MODE_WRITTEN), int(raw), True
            elif register in self._command:
                is_nothing = kind != _FLOAT and raw == -(1 << 8 * form.size - 1)
                self._command[register] = math.nan if is_nothing else raw * _SCALES[register][kind]
            elif register:
                answer += bytes((0x30, register, 2 if register in _SCALES else 1))
        return answer

    def _read(self, head: int, first: int, count: int, _stream: Iterator[int]) -> bytes:
        values = {0x00: self.mode, 0x01: self.position, 0x02: self.velocity, 0x03: self.torque, 0x0D: self.voltage}
        values |= {0x0E: _WARMTH, 0x0F: self.fault, **self._command}
        answer = bytes((head + 0x10, first) if head & 3 else (head + 0x10, count, first))
        for register in range(first, first + count):
            if register not in values:
                return bytes((0x31, register, 1))
            answer += _packed(values[register], register, head >> 2 & 3)
        return answer

    def _exchange_text(self, head: int, stream: Iterator[int]) -> bytes:
        """The diagnostic console; of its commands, `conf get`."""
        channel, size = next(stream), next(stream)
        if head == _POLL:
            text, self._console = self._console[:size], self._console[size:]
            return bytes((0x41, channel, len(text))) + text
        name = bytes(islice(stream, size)).decode("ascii", "replace").strip().removeprefix("conf get ")
        value = self.configuration.get(name)
        self._console += b"error reading\r\n" if value is None else f"{value:.6f}\r\n".encode()
        return bytes((0x41, channel, 0))


def _packed(value: float, register: int, kind: int) -> bytes:
    if kind == _FLOAT:
        return _FORMS[kind].pack(value)
    raw, most = value / _SCALES[register][kind], (1 << 8 * _FORMS[kind].size - 1) - 1
    return _FORMS[kind].pack(int(min(max(raw, -most), most)) if math.isfinite(raw) else -most - 1)


class SimulatedMoteus:
    """The controllers of all axes; see `Device`. They send nothing that they are not asked for."""

    refused_frames, has_supply = 0, True

    def __init__(self, link: Link, settings: MoteusSettings) -> None:
        """Switch them on."""
        self._link = link
        self.controllers = {name: Controller(axis) for name, axis in settings.axes.items()}
        self.inputs: Sequence[str] = tuple(f"{name}.torque" for name in settings.axes)
        self.needs: Sequence[str] = tuple(f"{name}.{of}" for name in settings.axes for of in ("angle", "velocity"))

    def obey(self, frames: Sequence[Frame], _now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process commands, answer them, and run the motors; see `Device.obey`."""
        if not self.has_supply:
            self.controllers = {name: Controller(each.settings) for name, each in self.controllers.items()}
        for name, controller in self.controllers.items():
            controller.position = controller.settings.motor(outputs[f"{name}.angle"]) / TURN
            controller.velocity = controller.settings.motor(outputs[f"{name}.velocity"]) / TURN
            controller.voltage = supply_voltage(outputs)
            for frame in frames if self.has_supply else ():
                self._receive(controller, frame)
        return [each.settings.wheel_torque(each.run()) for each in self.controllers.values()]

    def send_telemetry(self, _now_ns: int, _outputs: Mapping[str, float]) -> None:
        """Send nothing; see the class."""

    def _receive(self, controller: Controller, frame: Frame) -> None:
        own, asked = controller.settings.servo_id, frame.arbitration_id
        if asked >> 16 or asked & 0xFF not in (own, 0x7F) or frame.is_remote:
            return
        answer = controller.receive(frame.data)
        if asked & 0x8000:
            length = next(length for length in FD_LENGTHS if length >= len(answer))
            to, is_fd = own << 8 | asked >> 8 & 0x7F, frame.is_fd or length not in range(9)
            self._link.send(Frame(to, answer.ljust(length, b"\x50"), is_extended=bool(to >> 11), is_fd=is_fd))


def _press_stop(drives: SimulatedMoteus, pressed: bool) -> None:  # noqa: FBT001 - as the rig calls it
    drives.has_supply = not pressed


def _fail(drives: SimulatedMoteus) -> None:
    next(iter(drives.controllers.values())).fail(_DRIVER)


SIMULATED: Final[SimulatedDrives[MoteusSettings, SimulatedMoteus]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, _port: SimulatedMoteus(link, settings),
    press_stop=_press_stop,
    fail=_fail,
)
