# SPDX-License-Identifier: MIT
"""Telemetry of one axis: its frames decoded, checked, time-stamped and kept."""

from collections import Counter
from collections.abc import Collection, Mapping
from typing import Any, Final

from segway_ecc.firmware_io.devices import (
    SUPPLY_STALE_NS,
    SUPPLY_VOLTAGE,
    FrameKey,
    Freshness,
    Readings,
    stale_after_ns,
    with_one_more,
)
from segway_ecc.firmware_io.drives.enabling import wheel_signals
from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import (
    COMMANDS,
    ESTIMATES,
    HEARTBEAT,
    LAYOUTS,
    VERSION,
    WATCHDOG,
    Firmware,
    Message,
    angle_resolution,
    arbitration_id,
    decode,
    error_names,
    motor_motion,
)
from segway_ecc.firmware_io.drives.odrive.messages import AxisState
from segway_ecc.firmware_io.drives.odrive.probes import FirmwareSearch, WatchdogProof
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, NowNs

_SHOWN_IN_HEALTH: Final[Mapping[type[Any], str]] = {
    m.BusVoltageCurrent: "bus",
    m.Temperatures: "temperature",
    m.Currents: "motor_current",
    m.Torques: "motor_torque",
    m.Powers: "power",
    m.Errors: "errors",
    m.MotorError: "motor",
    m.EncoderError: "encoder",
    m.ControllerError: "controller",
}
_NOT_CALIBRATED: Final = 14
"""Result of a procedure (`ProcedureResult` in the firmware of 0.6)."""
_COMMANDS: Final = (VERSION, HEARTBEAT, 0x03, 0x04, ESTIMATES, 0x14, 0x15, 0x17, 0x1C, 0x1D)
"""Those that carry what is used here, in one firmware or the other."""


class AxisListener:
    """Keeps the newest telemetry of one axis.

    Attributes:
        signals: What it measures, with units; the left axis measures the supply too.
        error: Error bits of the newest heartbeat, which carries the state too, see `AxisState`.
        is_uncalibrated: Whether it reported that it lacks a calibration, when it was last asked for closed loop; 0.6.
        fresh: When `heartbeat`, `estimates`, `torque` and `supply` arrived.
        gap_ns: Time between the two newest heartbeats; 0 before there were two.
    """

    def __init__(self, name: str, settings: OdriveSettings, loop_period_s: float, now_ns: NowNs) -> None:
        """Listen to the axis of the wheel called `name`."""
        self.signals: Mapping[str, str] = wheel_signals(name) | ({SUPPLY_VOLTAGE: "V"} if name == "left" else {})
        self._wheel = settings.wheel(name)
        self.search = FirmwareSearch(settings.firmware)
        beat_s = max(settings.heartbeat_period_s, loop_period_s)
        # A cycle more, since what comes over a serial line is read up to one cycle late.
        self.proof = WatchdogProof(round((settings.watchdog_s + beat_s + loop_period_s) * 1e9))
        ids = (arbitration_id(self._wheel.node_id, command) for command in _COMMANDS)
        self.listens_to: Collection[FrameKey] = frozenset(map(FrameKey, ids))
        self.refused: Counter[Refusal] = Counter()
        self.error = 0
        self.state = int(AxisState.UNDEFINED)
        self.is_uncalibrated = False
        self.gap_ns = 0
        self.stale_beat_ns = stale_after_ns(settings.heartbeat_period_s, loop_period_s)
        stale_ns = {
            "heartbeat": self.stale_beat_ns,
            "estimates": stale_after_ns(settings.encoder_period_s, loop_period_s),
            "torque": stale_after_ns(settings.torque_period_s, loop_period_s),
            "supply": SUPPLY_STALE_NS,
        }
        self.fresh = Freshness(stale_ns, now_ns)
        self._beat_ns: int | None = None
        self._estimates = m.EncoderEstimates(0.0, 0.0)
        self._torque = 0.0
        self._supply = 0.0
        self._newest: dict[type[Any], Any] = {}

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the axis' frames; False where it was refused, which is counted."""
        if (frame.arbitration_id, frame.is_extended) not in self.listens_to:
            return False
        firmware = self._meaning(frame.arbitration_id % COMMANDS)
        if firmware is None or frame.arbitration_id % COMMANDS not in LAYOUTS[firmware]:
            return False  # what it means is not known yet, or nothing that is used here
        try:
            message = decode(firmware, frame.arbitration_id, frame.data)
        except FrameRefusedError as error:
            self.refused[error.refusal] += 1
            return False
        self._keep(message, frame.received_ns)
        return True

    def read(self) -> Readings:
        """Angle (rad), velocity (rad/s) and torque (N m) of the wheel; of the left axis the supply's voltage (V) too.

        The angle is the drive's own, which counts from power-on: its resolution is that of the wire's 32-bit float,
        4e-4 rad at 1000 turns of the motor and 6e-3 rad at 10000.
        """
        wheel = self._wheel.wheel
        angle, velocity = motor_motion(self._estimates)
        age, valid = self.fresh.age("estimates")
        torque_age, torque_valid = self.fresh.age("torque")
        values = (wheel(angle), wheel(velocity), self._wheel.wheel_torque(self._torque))
        readings = Readings(values, (age, age, torque_age), (valid, valid, torque_valid))
        if SUPPLY_VOLTAGE not in self.signals:
            return readings
        return with_one_more(readings, self._supply, self.fresh.age("supply"))

    @property
    def is_closed_loop(self) -> bool:
        """Whether the newest heartbeat reports closed loop and no error."""
        return self.state == AxisState.CLOSED_LOOP_CONTROL and not self.error

    @property
    def state_name(self) -> str:
        """The state for people."""
        return AxisState(self.state).name if self.state in set(AxisState) else f"state {self.state}"

    @property
    def errors(self) -> tuple[str, ...]:
        """The errors of the newest heartbeat for people."""
        return error_names(self.search.found or Firmware.V0_5, self.error)

    @property
    def health(self) -> Mapping[str, str]:
        """What the axis reports, and what was refused of it."""
        newest = {
            f"{_SHOWN_IN_HEALTH[kind]}.{field}": f"{value:g}"
            for kind, message in self._newest.items()
            for field, value in message._asdict().items()
            if value is not None
        }
        return {
            **{f"refused.{cause}": str(count) for cause, count in self.refused.items()},
            "state": self.state_name,
            "error": ", ".join(self.errors) or "none",
            "firmware": str(self.search),
            "watchdog_ms": "not seen" if self.proof.took_ns is None else f"{self.proof.took_ns * 1e-6:.1f}",
            "angle_resolution_rad": f"{abs(self._wheel.wheel(angle_resolution(self._estimates))):.1e}",
            **newest,
        }

    def _meaning(self, command: int) -> Firmware | None:
        """Whose meaning a command has; heartbeat and estimates are alike as far as they are used."""
        if command == VERSION:
            return Firmware.V0_6
        if command in (HEARTBEAT, ESTIMATES):
            return self.search.found or Firmware.V0_5
        return self.search.found

    def _keep(self, message: Message, received_ns: int) -> None:
        match message:
            case m.Heartbeat() | m.ProcedureHeartbeat():
                result = message.procedure_result if isinstance(message, m.ProcedureHeartbeat) else None
                self.is_uncalibrated = result == _NOT_CALIBRATED
                self._take_heartbeat(message.axis_error, message.state, received_ns)
            case m.EncoderEstimates():
                self._estimates = message
                self.fresh.mark("estimates", received_ns)
            case m.Version():
                before = self.search.found
                self.search.answer(message)
                if self.search.found is not before:
                    self.proof.reset()
            case m.Torques():
                self._measure(message.estimate_nm, received_ns)
            case m.BusVoltageCurrent(voltage):
                self._supply = voltage
                self.fresh.mark("supply", received_ns)
            case m.Currents() if self.search.found is Firmware.V0_5 and self._wheel.torque_constant is not None:
                self._measure(message.measured_a * self._wheel.torque_constant, received_ns)
        if type(message) in _SHOWN_IN_HEALTH:
            self._newest[type(message)] = message

    def _take_heartbeat(self, error: int, state: int, received_ns: int) -> None:
        self.error, self.state = error, state
        self.gap_ns = 0 if self._beat_ns is None else received_ns - self._beat_ns
        if self.gap_ns > self.stale_beat_ns:
            # It may have been switched off and on, with another configuration.
            self.proof.reset()
        self._beat_ns = received_ns
        self.fresh.mark("heartbeat", received_ns)
        self.search.beat(received_ns)
        if self.search.found is not None:
            self.proof.note_heartbeat(received_ns, expired=bool(error & WATCHDOG[self.search.found]))

    def _measure(self, motor_torque: float, received_ns: int) -> None:
        self._torque = motor_torque
        self.fresh.mark("torque", received_ns)
