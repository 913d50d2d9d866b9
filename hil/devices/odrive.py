# SPDX-License-Identifier: MIT
"""ODrives as their firmware behaves: boards with two axes each (0.5), or a board for each axis (0.6).

What is sent is packed here, not by the driver's codec, from communication/can/can_simple.cpp of
github.com/odriverobotics/ODrive and from ODrive's DBC files. The newest revision of can_simple.cpp that answers remote
frames only stands for 0.5.4: it has no Get_Controller_Error, no current of the supply, no flags in the heartbeat, no
cyclic messages but heartbeat and estimates, and sends d and q set-points as Get_Iq.
"""

import math
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import COMMANDS, Firmware, Message, arbitration_id, decode
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._odrive_ascii import AsciiPort
from segway_ecc.hil.devices._odrive_axis import ESTOP, Release, SimulatedAxis
from segway_ecc.hil.devices._odrive_board import ENDPOINTS, SimulatedBoard, find
from segway_ecc.hil.devices.device import supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

__all__ = ["TICK_NS", "Release", "SimulatedOdrive"]

TICK_NS: Final = 1_000_000
"""Period of the firmware's server of the bus."""
DEFAULT_RELEASES: Final = {Firmware.V0_5: Release.V0_5_6, Firmware.V0_6: Release.V0_6_10}
"""What runs where a robot file names no more than the firmware."""
_ON_A_BOARD: Final = 2
"""Axes of a board of 0.5."""
_FULL: Final = 8
_SETPOINTS: Final = (m.SetInputPosition, m.SetInputVelocity, m.SetInputTorque)
_HEARTBEAT: Final = 0x01
_RX_SDO: Final = 0x04
_TX_SDO: Final = 0x05
_ESTIMATES: Final = 0x09
_IQ: Final = 0x14
_BUS: Final = 0x17
_TORQUES: Final = 0x1C
_CONTROLLER_ERROR: Final = 0x1D
_SDO_HEAD: Final = struct.Struct("<BHB")
_SDO_READ: Final = 0
_SDO_WRITE: Final = 1

_Pack = Callable[[SimulatedAxis, SimulatedBoard], bytes]


def _floats(first: float, second: float) -> bytes:
    return struct.pack("<ff", first, second)


def _flags(axis: SimulatedAxis) -> tuple[bool, bool, bool]:
    """The heartbeat's: whether motor, encoder and controller have an error."""
    return bool(axis.motor_error), bool(axis.encoder_error), bool(axis.controller_error)


_V0_5_4: Final[Mapping[int, _Pack]] = {
    _HEARTBEAT: lambda axis, _: struct.pack("<IB3x", axis.error, axis.state),
    0x03: lambda axis, _: struct.pack("<Q", axis.motor_error),
    0x04: lambda axis, _: struct.pack("<I4x", axis.encoder_error),
    0x05: lambda _axis, _: bytes(_FULL),  # errors of the sensorless estimator, which has no part in this
    _ESTIMATES: lambda axis, _: _floats(*axis.can_estimates),
    0x0A: lambda axis, _: struct.pack("<ii", axis.counts, axis.counts % axis.counts_per_turn),
    _IQ: lambda axis, _: _floats(0.0, axis.current_a),
    0x15: lambda _axis, _: bytes(_FULL),
    _BUS: lambda _, board: _floats(board.supply_voltage, 0.0),
}
_PACK: Final[Mapping[Release, Mapping[int, _Pack]]] = {
    Release.V0_5_4: _V0_5_4,
    Release.V0_5_5: {
        **_V0_5_4,
        _HEARTBEAT: lambda axis, _: struct.pack("<IB???", axis.error, axis.state, *_flags(axis)),
        _IQ: lambda axis, _: _floats(axis.current_a, axis.current_a),
        _BUS: lambda _, board: _floats(board.supply_voltage, board.supply_current_a),
        _CONTROLLER_ERROR: lambda axis, _: struct.pack("<I4x", axis.controller_error),
    },
    Release.V0_6_10: {
        0x00: lambda axis, _: bytes((2, 4, 4, 58, *axis.release.numbers, 0)),
        _HEARTBEAT: lambda axis, _: struct.pack("<IBB2x", axis.error, axis.state, axis.procedure_result),
        0x03: lambda axis, _: struct.pack("<II", axis.active_errors, axis.disarm_reason),
        _ESTIMATES: lambda axis, _: _floats(*axis.can_estimates),
        _IQ: lambda axis, _: _floats(axis.current_a, axis.current_a),
        0x15: lambda _axis, _: _floats(30.0, math.nan),  # no sensor in the motor
        _BUS: lambda _, board: _floats(board.supply_voltage, board.supply_current_a),
        _TORQUES: lambda axis, _: _floats(axis.torque_nm, axis.torque_nm),
    },
}
"""The data of each message that is simulated, by its command; 0.5.6 has those of 0.5.5."""


@dataclass(slots=True)
class _Cycle:
    """A message that is sent again and again."""

    command: int
    period_ns: int
    last_ns: int | None = None

    def is_due(self, now_ns: int) -> bool:
        """Whether to send it now; it then counts as sent."""
        if not self.period_ns or (self.last_ns is not None and now_ns - self.last_ns < self.period_ns):
            return False
        self.last_ns = now_ns
        return True

    @property
    def next_ns(self) -> float:
        """When it is next due; infinite where it is never."""
        if not self.period_ns:
            return math.inf
        return -math.inf if self.last_ns is None else self.last_ns + self.period_ns


class SimulatedOdrive:
    """The axes of a robot on ODrives; see `Device`.

    Attributes:
        release: What runs on them.
        axes: The axes, in the order of the settings.
        boards: Those that they are on: two axes that follow one another share one (0.5), or each has its own (0.6).
        cycles: What each axis sends unasked, and how often.
        next_ns: See `Sleeping`: it sleeps while its torques follow from nothing but the newest set-points.
    """

    def __init__(
        self, link: Link, settings: OdriveSettings, port: Port | None = None, release: Release | None = None
    ) -> None:
        """Switch the drives on, configured as the settings have it.

        Args:
            link: The bus.
            settings: Their section of the robot file.
            port: The board's end of a serial line; 0.5.
            release: What runs on them; by default one of the firmware that the settings name, 0.5 for `auto`.
        """
        named = Firmware.V0_5 if settings.firmware == "auto" else Firmware(settings.firmware)
        self.release = DEFAULT_RELEASES[named] if release is None else release
        self.firmware = self.release.firmware
        self.inputs: Sequence[str] = [f"{name}.torque" for name in settings.axes]
        self.needs: Sequence[str] = [f"{name}.{value}" for name in settings.axes for value in ("angle", "velocity")]
        self._measured = itemgetter(*self.needs)
        self.axes = [SimulatedAxis(self.release, wheel, settings.watchdog_s) for wheel in settings.axes.values()]
        size = _ON_A_BOARD if self.firmware is Firmware.V0_5 else 1
        groups = [self.axes[first : first + size] for first in range(0, len(self.axes), size)]
        self.boards = [
            SimulatedBoard(self.release, sorted(axes, key=lambda axis: axis.settings.axis)) for axes in groups
        ]
        self.is_on = True
        self.cycles = [self._cycles(settings) for _ in self.axes]
        self._link = link
        self.next_ns = -math.inf
        self._due_ns = self._acts_ns = -math.inf
        self._refused = 0
        self._pack = _PACK.get(self.release, _PACK[Release.V0_5_5])
        self._ends = [(axis, self.boards[place // size]) for place, axis in enumerate(self.axes)]
        self._by_node = {axis.node_id: (axis, board) for axis, board in self._ends}
        self._ascii = None if port is None else AsciiPort(port, self.boards[0])

    @property
    def refused_frames(self) -> int:
        """Frames and lines refused since power-on."""
        return self._refused + (0 if self._ascii is None else self._ascii.refused)

    def switch_off(self) -> None:
        """Take the power away."""
        self.is_on, self.next_ns = False, -math.inf

    def switch_on(self) -> None:
        """Give the power back: everything but the configuration is lost."""
        self.is_on, self.next_ns = True, -math.inf
        for board in self.boards:
            board.restart()

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process frames and lines, run the states and watchdogs; see `Device.obey`."""
        if not self.is_on:
            if self._ascii is not None:
                self._ascii.discard()
            return (0.0,) * len(self.axes)
        self._move(outputs)
        for frame in frames:
            end = None if frame.is_extended else self._by_node.get(frame.arbitration_id // COMMANDS)
            if end is not None:
                self._receive(*end, frame, now_ns)
        if self._ascii is not None:
            self._ascii.serve(now_ns)
        for board in self.boards:
            board.check_supply()
        for axis in self.axes:
            axis.tick(now_ns)
        self._acts_ns = self._next_act_ns(now_ns)
        self.next_ns = min(self._acts_ns, self._due_ns)
        return [axis.settings.wheel_torque(axis.torque_nm) for axis in self.axes]

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send what is due."""
        if not self.is_on or now_ns < self._due_ns:  # as in most ticks
            return
        due = [
            (end, cycle.command)
            for end, cycles in zip(self._ends, self.cycles, strict=True)
            for cycle in cycles
            if cycle.is_due(now_ns)
        ]
        self._due_ns = min(cycle.next_ns for cycles in self.cycles for cycle in cycles)
        self.next_ns = min(self._acts_ns, self._due_ns)
        if due:
            self._move(outputs)
        for (axis, board), command in due:
            self._send(axis, board, command)

    def _next_act_ns(self, now_ns: int) -> float:
        """When, after a pass now, the next one may change anything; bytes of the serial line come at any time."""
        if self._ascii is not None or any([board.limits_current for board in self.boards]):  # noqa: C419 - a generator takes longer
            return -math.inf
        return min([axis.next_ns(now_ns) for axis in self.axes])

    def _cycles(self, settings: OdriveSettings) -> list[_Cycle]:
        periods = [(_HEARTBEAT, settings.heartbeat_period_s), (_ESTIMATES, settings.encoder_period_s)]
        if self.release is not Release.V0_5_4:
            torque = _IQ if self.firmware is Firmware.V0_5 else _TORQUES
            periods += [(torque, settings.torque_period_s), (_BUS, 0.1)]
        return [_Cycle(command, round(period_s * 1e9)) for command, period_s in periods]

    def _move(self, outputs: Mapping[str, float]) -> None:
        values, supply, place = self._measured(outputs), supply_voltage(outputs), 0
        for axis in self.axes:
            axis.move(values[place], values[place + 1])
            axis.supply_voltage = supply
            place += 2

    def _receive(self, axis: SimulatedAxis, board: SimulatedBoard, frame: Frame, now_ns: int) -> None:
        """Process a frame. To 0.5 any one feeds the watchdog; to 0.6 a set-point does, as far as is known."""
        if self.firmware is Firmware.V0_5:
            axis.feed(now_ns)
        command = frame.arbitration_id % COMMANDS
        if command in self._pack and self._is_question(frame, command):
            if command != _HEARTBEAT:  # which is not sent on request
                self._send(axis, board, command)
            return
        if self.firmware is Firmware.V0_6 and command == _RX_SDO:
            self._serve_sdo(axis, board, frame.data)
            return
        # 0.5 reads its buffer however short the frame was.
        data = frame.data.ljust(_FULL, b"\0") if self.firmware is Firmware.V0_5 else frame.data
        try:
            message = decode(self.firmware, frame.arbitration_id, data)
        except FrameRefusedError:
            self._refused += 1
            return
        if isinstance(message, _SETPOINTS):
            axis.feed(now_ns)
        self._obey(axis, board, message)

    def _is_question(self, frame: Frame, command: int) -> bool:
        """Remote frames are; empty ones from 0.5.5 on; and 0.5.5 checks nothing of Get_Controller_Error."""
        if frame.is_remote or self.release is Release.V0_5_4:
            return frame.is_remote
        return not frame.data or (self.firmware is Firmware.V0_5 and command == _CONTROLLER_ERROR)

    def _serve_sdo(self, axis: SimulatedAxis, board: SimulatedBoard, data: bytes) -> None:
        """Read or write an endpoint; a write is not confirmed before 0.6.11, and what is not there not answered."""
        opcode, endpoint, _ = _SDO_HEAD.unpack(data[: _SDO_HEAD.size].ljust(_SDO_HEAD.size, b"\0"))
        found = find(board, ENDPOINTS.get(endpoint, "")) if len(data) >= _SDO_HEAD.size else None
        if found is not None and opcode == _SDO_READ:
            reply = _SDO_HEAD.pack(0, endpoint, 0) + found.pack()
            self._link.send(Frame(arbitration_id(axis.node_id, _TX_SDO), reply))
        elif found is None or opcode != _SDO_WRITE or not found.unpack(data[_SDO_HEAD.size :]):
            self._refused += 1

    def _obey(self, axis: SimulatedAxis, board: SimulatedBoard, message: Message) -> None:
        """Obey a message; a control mode is changed by its own frame only."""
        match message:
            case m.SetAxisState(state):
                axis.request(state)
            case m.SetControllerMode(control_mode, input_mode):
                axis.control_mode, axis.input_mode = control_mode, input_mode
            case m.SetInputTorque(torque):
                axis.set_input(torque)
            case m.SetInputVelocity(velocity, torque):
                axis.set_input(torque, velocity)
            case m.SetInputPosition(position, velocity, torque):
                axis.set_input(torque, velocity, position)
            case _:
                self._manage(axis, board, message)

    def _manage(self, axis: SimulatedAxis, board: SimulatedBoard, message: Message) -> None:
        match message:
            case m.Estop():
                axis.latch(ESTOP[self.firmware])
            case m.ClearErrors() | m.ClearAxisErrors():
                board.clear_errors()
            case m.Reboot():
                board.restart()
            case m.RebootAction(action) if action == 0:
                board.restart()
            case m.SetLimits(velocity, current):
                axis.velocity_limit_rev_s, axis.current_limit_a = velocity, current
            case m.SetLinearCount(counts):
                axis.set_origin(counts / axis.counts_per_turn)
            case m.SetAbsolutePosition(position):
                axis.set_origin(position)

    def _send(self, axis: SimulatedAxis, board: SimulatedBoard, command: int) -> None:
        self._link.send(Frame(arbitration_id(axis.node_id, command), self._pack[command](axis, board)))


def _press_stop(drives: SimulatedOdrive, pressed: bool) -> None:  # noqa: FBT001 - as the rig calls it
    if drives.is_on == pressed:
        (drives.switch_off if pressed else drives.switch_on)()


def _lose_watchdog(drives: SimulatedOdrive) -> None:
    for axis in drives.axes:
        axis.watchdog_s = None


def _fail(drives: SimulatedOdrive) -> None:
    drives.axes[0].exceed_current()
    drives.next_ns = -math.inf


def _of(release: Release) -> Callable[[OdriveSettings, Link, Port | None], SimulatedOdrive]:
    return lambda settings, link, port: SimulatedOdrive(link, settings, port, release)


SIMULATED: Final[SimulatedDrives[OdriveSettings, SimulatedOdrive]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, port: SimulatedOdrive(link, settings, port),
    variants={release.value: _of(release) for release in Release},
    press_stop=_press_stop,
    lose_watchdog=_lose_watchdog,
    fail=_fail,
)
