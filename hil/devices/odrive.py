# SPDX-License-Identifier: MIT
"""ODrives as their firmware behaves: one board with two axes (0.5), or a board for each wheel (0.6)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import COMMANDS, LAYOUTS, Firmware, Message, decode, encode
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._odrive_axis import ESTOP, AsciiPort, SimulatedAxis
from segway_ecc.hil.devices.device import supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

TICK_NS: Final = 1_000_000
"""Period of the firmware's server of the bus."""
_NAMES: Final = ("left", "right")
_WHEELS: Final = ("left.angle", "left.velocity", "right.angle", "right.velocity")
_wheels = itemgetter(*_WHEELS)
_FULL: Final = 8
_VERSION: Final = m.Version(2, 4, 4, 58, 0, 6, 10, 0)
_SETPOINTS: Final = (m.SetInputPosition, m.SetInputVelocity, m.SetInputTorque)
_TELEMETRY: Final[Mapping[type[Message], Callable[[SimulatedAxis], Message]]] = {
    m.Heartbeat: lambda axis: m.Heartbeat(axis.error, axis.state),
    m.ProcedureHeartbeat: lambda axis: m.ProcedureHeartbeat(axis.error, axis.state, axis.procedure_result),
    m.EncoderEstimates: lambda axis: m.EncoderEstimates(axis.position_rev, axis.velocity_rev_s),
    m.EncoderCount: lambda axis: m.EncoderCount(axis.counts, axis.counts % axis.counts_per_turn),
    m.Currents: lambda axis: m.Currents(axis.current_a, axis.current_a),
    m.Torques: lambda axis: m.Torques(axis.torque_nm, axis.torque_nm),
    m.BusVoltageCurrent: lambda axis: m.BusVoltageCurrent(axis.supply_voltage, axis.supply_current_a),
    m.Errors: lambda axis: m.Errors(axis.error, axis.error),
    m.Temperatures: lambda _: m.Temperatures(30.0, None),
    m.MotorError: lambda _: m.MotorError(0),
    m.EncoderError: lambda _: m.EncoderError(0),
    m.Version: lambda _: _VERSION,
}
"""What an axis sends in each message that is simulated."""
_UNASKED: Final = (m.Heartbeat, m.ProcedureHeartbeat)
"""What is not sent on request."""


@dataclass(slots=True)
class _Cycle:
    """A message that is sent again and again."""

    message: type[Message]
    period_ns: int
    last_ns: int | None = None

    def is_due(self, now_ns: int) -> bool:
        """Whether to send it now; it then counts as sent."""
        if not self.period_ns or (self.last_ns is not None and now_ns - self.last_ns < self.period_ns):
            return False
        self.last_ns = now_ns
        return True


class SimulatedOdrive:
    """Two wheels on ODrives; see `Device`. For each axis, left first, `cycles` is what it sends unasked, how often."""

    inputs: Sequence[str] = ("left.torque", "right.torque")
    needs: Sequence[str] = _WHEELS

    def __init__(
        self, link: Link, settings: OdriveSettings, port: Port | None = None, firmware: Firmware | None = None
    ) -> None:
        """Switch the drives on, configured as the settings have it.

        Args:
            link: The bus.
            settings: Their section of the robot file.
            port: The board's end of a serial line; 0.5.
            firmware: What runs on them; by default what the settings name, 0.5 for `auto`.
        """
        auto = Firmware.V0_5 if settings.firmware == "auto" else Firmware(settings.firmware)
        self.firmware = auto if firmware is None else firmware
        self.axes = [SimulatedAxis(self.firmware, settings.wheel(name), settings.watchdog_s) for name in _NAMES]
        self.is_on = True
        self.cycles = [self._cycles(settings) for _ in self.axes]
        self._link = link
        self._refused = 0
        self._by_node = {axis.node_id: axis for axis in self.axes}
        in_board_order = sorted(self.axes, key=lambda axis: axis.settings.axis)
        self._ascii = None if port is None else AsciiPort(port, in_board_order, self._clear_board)

    @property
    def refused_frames(self) -> int:
        """Frames and lines refused since power-on."""
        return self._refused + (0 if self._ascii is None else self._ascii.refused)

    def switch_off(self) -> None:
        """Take the power away."""
        self.is_on = False

    def switch_on(self) -> None:
        """Give the power back: everything but the configuration is lost."""
        self.is_on = True
        for axis in self.axes:
            axis.restart()

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process frames and lines, run the states and watchdogs; see `Device.obey`."""
        if not self.is_on:
            if self._ascii is not None:
                self._ascii.discard()
            return (0.0, 0.0)
        self._move(outputs)
        for frame in frames:
            axis = None if frame.is_extended else self._by_node.get(frame.arbitration_id // COMMANDS)
            if axis is not None:
                self._receive(axis, frame, now_ns)
        if self._ascii is not None:
            self._ascii.serve(now_ns)
        left, right = self.axes
        for axis in self.axes:
            # An error on one axis of 0.5 keeps the other from closed loop; each 0.6 is a board of its own.
            has_errors = self.firmware is Firmware.V0_5 and bool(left.error or right.error)
            axis.tick(now_ns, board_has_errors=has_errors)
        return [axis.settings.wheel_torque(axis.torque_nm) for axis in self.axes]

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send what is due."""
        if not self.is_on:
            return
        due = [
            (axis, cycle.message)
            for axis, cycles in zip(self.axes, self.cycles, strict=True)
            for cycle in cycles
            if cycle.is_due(now_ns)
        ]
        if due:  # in one tick of several
            self._move(outputs)
        for axis, message in due:
            self._send(axis, message)

    def _cycles(self, settings: OdriveSettings) -> list[_Cycle]:
        torque = m.Currents if self.firmware is Firmware.V0_5 else m.Torques
        beat = m.Heartbeat if self.firmware is Firmware.V0_5 else m.ProcedureHeartbeat
        periods: list[tuple[type[Message], float]] = [
            (beat, settings.heartbeat_period_s),
            (m.EncoderEstimates, settings.encoder_period_s),
            (torque, settings.torque_period_s),
            (m.BusVoltageCurrent, 0.1),
        ]
        return [_Cycle(message, round(period_s * 1e9)) for message, period_s in periods]

    def _move(self, outputs: Mapping[str, float]) -> None:
        left, right = self.axes
        left_angle, left_velocity, right_angle, right_velocity = _wheels(outputs)
        left.move(left_angle, left_velocity)
        right.move(right_angle, right_velocity)
        left.supply_voltage = right.supply_voltage = supply_voltage(outputs)

    def _clear_board(self) -> None:
        for axis in self.axes:
            axis.error = 0

    def _receive(self, axis: SimulatedAxis, frame: Frame, now_ns: int) -> None:
        """Process a frame. To 0.5 any one feeds the watchdog; to 0.6 a set-point does, as far as is known."""
        if self.firmware is Firmware.V0_5:
            axis.feed(now_ns)
        if frame.is_remote or not frame.data:
            layout = LAYOUTS[self.firmware].get(frame.arbitration_id % COMMANDS)
            if layout is not None and layout.message in _TELEMETRY:
                if layout.message not in _UNASKED:
                    self._send(axis, layout.message)
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
        self._obey(axis, message, now_ns)

    def _obey(self, axis: SimulatedAxis, message: Message, now_ns: int) -> None:
        """Obey a message; a control mode is changed by its own frame only."""
        match message:
            case m.SetAxisState(state):
                axis.request(state, now_ns)
            case m.SetControllerMode(control_mode, input_mode):
                axis.control_mode, axis.input_mode = control_mode, input_mode
            case m.SetInputTorque(torque):
                axis.set_input(torque)
            case m.SetInputVelocity(velocity, torque):
                axis.set_input(torque, velocity)
            case m.SetInputPosition(position, velocity, torque):
                axis.set_input(torque, velocity, position)
            case _:
                self._manage(axis, message)

    def _manage(self, axis: SimulatedAxis, message: Message) -> None:
        match message:
            case m.Estop():
                axis.latch(ESTOP[self.firmware])
            case m.ClearErrors():
                self._clear_board()
            case m.ClearAxisErrors():
                axis.error = 0
            case m.Reboot():
                for each in self.axes:
                    each.restart()
            case m.RebootAction(action) if action == 0:
                axis.restart()
            case m.SetLimits(velocity, current):
                axis.velocity_limit_rev_s, axis.current_limit_a = velocity, current
            case m.SetLinearCount(counts):
                axis.set_origin(counts / axis.counts_per_turn)
            case m.SetAbsolutePosition(position):
                axis.set_origin(position)

    def _send(self, axis: SimulatedAxis, kind: type[Message]) -> None:
        self._link.send(encode(self.firmware, axis.node_id, _TELEMETRY[kind](axis)))


def _press_stop(drives: SimulatedOdrive, pressed: bool) -> None:  # noqa: FBT001 - as the rig calls it
    if drives.is_on == pressed:
        (drives.switch_off if pressed else drives.switch_on)()


def _lose_watchdog(drives: SimulatedOdrive) -> None:
    for axis in drives.axes:
        axis.watchdog_s = None


SIMULATED: Final[SimulatedDrives[OdriveSettings, SimulatedOdrive]] = SimulatedDrives(
    tick_ns=TICK_NS,
    device=lambda settings, link, port: SimulatedOdrive(link, settings, port),
    press_stop=_press_stop,
    lose_watchdog=_lose_watchdog,
)
