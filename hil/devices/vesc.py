# SPDX-License-Identifier: MIT
"""VESC controllers on one bus, one of them with its UART connected, as their firmware behaves.

Simplified: packets between them take no time; the current follows its target with a lag, whatever the supply
voltage; the modes that the driver does not use follow their targets proportionally.
"""

import enum
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.vesc.frames import (
    BROADCAST_ID,
    FIELD_NAMES,
    SET_PACKETS,
    TIMED_OUT,
    Comm,
    PacketId,
    Payload,
    Ping,
    Pong,
    Status,
    Status5,
    addressed,
    arbitration_id,
    decode,
    encode_values,
    frame_of,
    mask_of,
    read_mask,
)
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketReceiver, decode_short, frame_packet, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._vesc_configuration import Firmware, configuration_reply, version_reply
from segway_ecc.hil.devices.device import SUPPLY_VOLTAGE, supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

__all__ = ["TICK_NS", "Controller", "Firmware", "SimulatedVesc", "VescFault"]

TICK_NS: Final = 1_000_000
"""Period of the simulated firmware's loop."""

_WATCH_NS: Final = 10_000_000
"""How often the firmware looks at its time-out."""
_FAULT_NS: Final = 500_000_000
_CURRENT_LAG_S: Final = 0.001
_CURRENT_STEP: Final = 1.0 - math.exp(-TICK_NS * 1e-9 / _CURRENT_LAG_S)
_MIN_CURRENT: Final = 0.05
_LEAST_VOLTAGE: Final = 1.0
"""The duty cycle is a part of the supply, which must not be nothing."""
_RESISTANCE: Final = 0.1
_SPEED_GAIN: Final = 0.01
_POSITION_GAIN: Final = 5.0
_STEPS_PER_TURN: Final = 6
_TACHOMETER_MESSAGE: Final = 5
_SET: Final = frozenset(SET_PACKETS) | {PacketId.SET_CURRENT_BRAKE_REL, PacketId.SET_CURRENT_HANDBRAKE_REL}
_RELATIVE: Final = frozenset(command for command in _SET if command.name.endswith("_REL"))
_BRAKING: Final = frozenset(command for command in _SET if "BRAKE" in command.name)
_FLAGS: Final = mask_of(("flags",))


class VescFault(enum.IntEnum):
    """Faults that a test can call up; the numbers are the firmware's."""

    NONE = 0
    OVER_VOLTAGE = 1
    OVER_TEMPERATURE = 5


class Controller:
    """One VESC with its motor.

    Attributes:
        current: Motor current, A.
        fault: The fault that it reports.
        bus_voltage: Supply, V.
        has_timed_out: Whether its time-out has acted and no command has come since.
    """

    def __init__(self, settings: VescWheelSettings, firmware: Firmware) -> None:
        """Switch a controller on."""
        self.firmware = firmware
        self.controller_id = settings.controller_id
        self.current = 0.0
        self.fault = VescFault.NONE
        self.bus_voltage = SUPPLY_VOLTAGE
        self.has_timed_out = False
        self._settings = settings
        self._mode = PacketId.SET_CURRENT
        self._target = 0.0
        self._commanded_ns = 0
        self._watched_ns = -_WATCH_NS
        self._fault_until_ns: int | None = None
        self._sent_ns: dict[int, int] = {}
        self._angle = 0.0
        self._velocity = 0.0

    def measure(self, angle: float, velocity: float, bus_voltage: float = SUPPLY_VOLTAGE) -> None:
        """Take the wheel's angle, rad, and velocity, rad/s, and the supply, V, which is no less than a volt."""
        self.bus_voltage = max(bus_voltage, _LEAST_VOLTAGE)
        self._angle = self._settings.motor(angle)
        self._velocity = self._settings.motor(velocity)

    def fail(self, fault: VescFault) -> None:
        """Report a fault for half a second from the next pass on, with the motor free."""
        self.fault, self._fault_until_ns = fault, None

    def obey(self, command: PacketId, payload: Payload, now_ns: int) -> None:
        """Take a set command; any other is ignored."""
        if command in _SET:
            self._mode, self._target = command, payload[0]
            self.stay_alive(now_ns)

    def stay_alive(self, now_ns: int) -> None:
        """Take a sign of life."""
        self._commanded_ns = now_ns

    def run(self, now_ns: int) -> float:
        """One pass of the loops; returns the torque at the wheel, N m."""
        if now_ns - self._watched_ns >= _WATCH_NS:
            self._watched_ns, timeout_ns = now_ns, self.firmware.timeout_s * 1e9
            self.has_timed_out = timeout_ns > 0 and now_ns - self._commanded_ns > timeout_ns
            if self.has_timed_out:
                self._mode, self._target = PacketId.SET_CURRENT_BRAKE, self.firmware.timeout_brake_current
        if self.fault and self._fault_until_ns is None:
            self._fault_until_ns = now_ns + _FAULT_NS
        if self._fault_until_ns is not None and now_ns >= self._fault_until_ns:
            self.fault, self._fault_until_ns = VescFault.NONE, None
        wanted = 0.0 if self.fault else self._limited(self._wanted_current())
        self.current += ((wanted if abs(wanted) >= _MIN_CURRENT else 0.0) - self.current) * _CURRENT_STEP
        return self._settings.wheel_torque(self.current * self._settings.torque_constant)

    def due(self, now_ns: int) -> list[Frame]:
        """The status messages that are to be sent now; what the model does not know is zero in them."""
        frames = []
        for number, rate_hz in self.firmware.status.items():
            sent_ns = self._sent_ns.get(number)
            if sent_ns is None or now_ns - sent_ns >= round(1e9 / rate_hz):
                self._sent_ns[number] = now_ns
                if number == 1:
                    status = Status(self._erpm, self._power_current, self._duty)
                    frames.append(frame_of(PacketId.STATUS, self.controller_id, status))
                elif number == _TACHOMETER_MESSAGE:
                    status_5 = Status5(self._tachometer, self.bus_voltage)
                    frames.append(frame_of(PacketId.STATUS_5, self.controller_id, status_5))
                else:
                    identifier = arbitration_id(PacketId[f"STATUS_{number}"], self.controller_id)
                    frames.append(Frame(identifier, bytes(8), is_extended=True))
        return frames

    def reply(self, question: bytes) -> bytes:
        """The reply to a GET_VALUES or GET_VALUES_SELECTIVE packet."""
        values = dict.fromkeys(FIELD_NAMES, 0.0) | {
            "motor_current": self._power_current,
            "q_current": self.current,
            "duty": self._duty,
            "erpm": self._erpm,
            "bus_voltage": self.bus_voltage,
            "tachometer": self._tachometer,
            "fault": self.fault,
            "controller_id": self.controller_id,
            "flags": TIMED_OUT if self.has_timed_out else 0,
        }
        reply = encode_values(question, values)
        return reply if self.firmware.knows_flags or not read_mask(question) & _FLAGS else reply[:-1]

    def _wanted_current(self) -> float:
        """The motor current that the mode asks for, A."""
        target = self._target
        if self._mode in _RELATIVE:
            target = min(max(target, -1.0), 1.0) * self.firmware.max_current
        if self._mode in _BRAKING:
            return -math.copysign(target, self._velocity) if self._velocity else 0.0
        match self._mode:
            case PacketId.SET_DUTY:
                most = self.firmware.max_duty
                return (min(max(target, -most), most) - self._induced_duty) * self.bus_voltage / _RESISTANCE
            case PacketId.SET_RPM:
                return (target - self._erpm) * _SPEED_GAIN
            case PacketId.SET_POS:
                return math.remainder(math.radians(target) - self._angle, TURN) * _POSITION_GAIN
        return target

    def _limited(self, current: float) -> float:
        """A motor current within its limits: one for driving, which falls near the limit of speed, one for braking."""
        firmware = self.firmware
        begins = firmware.erpm_start * firmware.max_erpm
        share = min(max((firmware.max_erpm - abs(self._erpm)) / max(firmware.max_erpm - begins, 1.0), 0.0), 1.0)
        driving, braking = firmware.max_current * share, firmware.braking_current
        if self._velocity < 0.0:
            return min(max(current, -driving), braking)
        return min(max(current, -braking), driving)

    @property
    def _power_current(self) -> float:
        """The motor current in STATUS and GET_VALUES, A.

        It has the sign of voltage times current, which is that of the power, and the magnitude of the current
        (`mcpwm_foc_get_tot_current_filtered`, which `comm_can_send_status1` sends; bldc 6.05).
        """
        return math.copysign(self.current, self.current * self._duty)

    @property
    def _induced_duty(self) -> float:
        """The duty cycle as far as speed makes it."""
        return min(max(self._settings.torque_constant * self._velocity / self.bus_voltage, -1.0), 1.0)

    @property
    def _duty(self) -> float:
        """The duty cycle: what speed induces, and what drives the current through the resistance."""
        return min(max(self._induced_duty + self.current * _RESISTANCE / self.bus_voltage, -1.0), 1.0)

    @property
    def _erpm(self) -> int:
        return int(self._velocity * self._settings.pole_pairs * 60.0 / TURN)

    @property
    def _tachometer(self) -> int:
        steps = math.floor(self._angle * self._settings.pole_pairs * _STEPS_PER_TURN / TURN)
        return (steps + (1 << 31)) % (1 << 32) - (1 << 31)


_SET_BY_PACKET: Final = {int(packet): command for command, packet in SET_PACKETS.items()}


_VARIANTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "6.05": {},
    "5.02": {"version": (5, 2), "answers_configuration": False},
    "weak": {"max_current": 1.0},
}
"""By name, for robot files. The configuration of 5.02 has another layout, which is not simulated, nor asked for; one
that is weak has a motor current set that is too small, so that the robot is not armed."""


class SimulatedVesc:
    """All controllers; see `Device`. A test may break the bus between them; unusable frames are counted.

    Attributes:
        controllers: By the name of their axis.
    """

    def __init__(
        self, link: Link, settings: VescSettings, port: Port | None = None, firmware: Firmware | None = None
    ) -> None:
        """Switch the controllers on, set up by `settings` where no `firmware` is given."""
        used = firmware or _set_up(settings)
        self.inputs: Sequence[str] = [f"{name}.torque" for name in settings.axes]
        self.needs: Sequence[str] = [f"{name}.{value}" for name in settings.axes for value in ("angle", "velocity")]
        self.controllers = {name: Controller(wheel, used) for name, wheel in settings.axes.items()}
        self.bus_is_whole = True
        self.refused_frames = 0
        self._all = list(self.controllers.values())
        self._near = self.controllers[settings.serial_controller or next(iter(settings.axes))]
        self._link = link
        self._port = port
        self._receiver = PacketReceiver()

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process commands from both lines and run the motors; see `Device.obey`."""
        self._measure(outputs)
        for frame in frames:
            self._receive(frame, now_ns)
        if self._port is not None:
            for packet in self._receiver.feed(self._port.read(self._port.in_waiting)):
                reply = self._process(self._near, packet, now_ns)
                if reply is not None:
                    self._port.write(frame_packet(reply))
        return [controller.run(now_ns) for controller in self._all]

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send the status messages that are due."""
        self._measure(outputs)
        for controller in self._all:
            for frame in controller.due(now_ns):
                self._link.send(frame)

    def _measure(self, outputs: Mapping[str, float]) -> None:
        for name, controller in self.controllers.items():
            controller.measure(outputs[f"{name}.angle"], outputs[f"{name}.velocity"], supply_voltage(outputs))

    def _receive(self, frame: Frame, now_ns: int) -> None:
        address = addressed(frame)
        for controller in self._all:
            if address is None or address[1] not in (controller.controller_id, BROADCAST_ID):
                continue
            try:
                self._obey(controller, address[0], frame.data, now_ns)
            except FrameRefusedError:
                self.refused_frames += 1

    def _obey(self, controller: Controller, command: PacketId, data: bytes, now_ns: int) -> None:
        if command is not PacketId.PROCESS_SHORT_BUFFER:
            payload = decode(command, data)
            controller.obey(command, payload, now_ns)
            if isinstance(payload, Ping):
                self._link.send(frame_of(PacketId.PONG, payload.sender_id, Pong(controller.controller_id, 0)))
            return
        short = decode_short(data)
        reply = None if short.mode is Mode.PASS_ON else self._process(controller, short.packet, now_ns)
        if reply is not None and short.mode is Mode.PROCESS:
            self._send(short.sender_id, controller, Mode.PASS_ON, reply)

    def _process(self, controller: Controller, packet: bytes, now_ns: int) -> bytes | None:
        try:
            if packet[0] in (Comm.GET_VALUES, Comm.GET_VALUES_SELECTIVE):
                return controller.reply(packet)
            if packet[0] == Comm.FW_VERSION:
                return version_reply(controller.controller_id, controller.firmware.version)
            if packet[0] == Comm.GET_MCCONF:
                return configuration_reply(controller.firmware) if controller.firmware.answers_configuration else None
            if packet[0] in _SET_BY_PACKET:
                command = _SET_BY_PACKET[packet[0]]
                controller.obey(command, decode(command, packet[1:5]), now_ns)
            elif packet[0] == Comm.ALIVE:
                controller.stay_alive(now_ns)
            elif packet[0] == Comm.FORWARD_CAN and controller is self._near:
                return self._forward(packet[1:], now_ns)
        except FrameRefusedError:
            self.refused_frames += 1
        return None

    def _forward(self, packet: bytes, now_ns: int) -> bytes | None:
        far = next((each for each in self._all if packet[:1] == bytes((each.controller_id,))), self._near)
        if far is self._near or not self.bus_is_whole:
            return None
        self._send(far.controller_id, self._near, Mode.PROCESS, packet[1:])
        reply = self._process(far, packet[1:], now_ns)
        if reply is not None:
            self._send(self._near.controller_id, far, Mode.PASS_ON, reply)
        return reply

    def _send(self, receiver_id: int, sender: Controller, mode: Mode, packet: bytes) -> None:
        for frame in frames_of(receiver_id, sender.controller_id, mode, packet):
            self._link.send(frame)


def _set_up(settings: VescSettings) -> Firmware:
    """A controller as the settings of a robot file want it."""
    rate_hz = settings.status_rate_hz
    return Firmware(timeout_s=settings.timeout_set_s, status={1: rate_hz, 5: rate_hz})


def _of(changes: Mapping[str, Any]) -> Callable[[VescSettings, Link, Port | None], SimulatedVesc]:
    return lambda settings, link, port: SimulatedVesc(link, settings, port, replace(_set_up(settings), **changes))


def _fail(drives: SimulatedVesc) -> None:
    next(iter(drives.controllers.values())).fail(VescFault.OVER_TEMPERATURE)


SIMULATED: Final[SimulatedDrives[VescSettings, SimulatedVesc]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, port: SimulatedVesc(link, settings, port),
    variants={name: _of(changes) for name, changes in _VARIANTS.items()},
    fail=_fail,
)
