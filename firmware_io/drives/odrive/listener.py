# SPDX-License-Identifier: MIT
"""Telemetry of one axis, decoded, checked, time-stamped and kept; and what an axis must prove: its watchdog."""

import math
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
from segway_ecc.firmware_io.drives.odrive.causes import ErrorCauses
from segway_ecc.firmware_io.drives.odrive.firmware_search import FirmwareSearch
from segway_ecc.firmware_io.drives.odrive.frames import (
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
from segway_ecc.firmware_io.drives.odrive.own_settings import OwnSettings
from segway_ecc.firmware_io.drives.odrive.sdo import TX_SDO, settings_reading
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, NowNs

_CLEAR_EVERY_NS: Final = 300_000_000
"""Shortest time between two attempts to see the watchdog expire; longer than any that may be set."""
_NEVER: Final = -(1 << 62)
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
_COMMANDS: Final = (VERSION, HEARTBEAT, 0x03, 0x04, TX_SDO, ESTIMATES, 0x14, 0x15, 0x17, 0x1C, 0x1D)
"""Those that carry what is used here, in one firmware or the other."""


class WatchdogProof:
    """Proof, by what it does, that an axis' own watchdog is on and short enough.

    CANSimple of firmware 0.5 cannot read the watchdog's configuration. But the watchdog is checked in every state: an
    idle axis that receives nothing raises its error. So the error of an axis that reports it is cleared, and then it is
    left in silence: a heartbeat without the error shows that the command has arrived, however long that took, and the
    next one with it that the watchdog has expired since. The time between is an upper bound of the time-out.

    Attributes:
        took_ns: From the command to clear the error to the error; None until it was seen.
        within_ns: The longest that it may take.
        is_expired: Whether the newest heartbeat carried the error.
    """

    def __init__(self, within_ns: int) -> None:
        """Take a watchdog for proved that took no longer than `within_ns`."""
        self.took_ns: int | None = None
        self.within_ns = within_ns
        self._begun_ns: int | None = None
        self._cleared_ns = _NEVER
        self._was_clean = False
        self.is_expired = False

    @property
    def is_proven(self) -> bool:
        """Whether the watchdog was seen to expire in time."""
        return self.took_ns is not None and self.took_ns <= self.within_ns

    def feed(self) -> None:
        """A frame was sent to the axis; in firmware 0.5 any feeds the watchdog, which ends an attempt."""
        self._begun_ns = None
        self._was_clean = False

    def clear(self, now_ns: int) -> None:
        """The axis was fed and its error cleared, which begins an attempt."""
        self._cleared_ns = now_ns
        # Heartbeats on their way now all carry the error; without it they can only have been sent after the clearing.
        self._begun_ns = now_ns if self.is_expired else None

    def note_heartbeat(self, received_ns: int, *, expired: bool) -> None:
        """A heartbeat arrived, with or without the watchdog's error."""
        self.is_expired = expired
        if self._begun_ns is None:
            return
        if not expired:
            self._was_clean = True
        elif self._was_clean:
            if not self.is_proven:
                self.took_ns = received_ns - self._begun_ns
            self._begun_ns = None

    def reset(self) -> None:
        """The drive may have been restarted: what was seen means nothing any more."""
        self.took_ns = None
        self._begun_ns = None
        self._was_clean = False

    def needs_clearing(self, now_ns: int) -> bool:
        """Whether another attempt is due: the error stands, so that it cannot be seen to begin.

        One that took too long is tried again: a lost heartbeat may have been the reason.
        """
        return not self.is_proven and self.is_expired and now_ns - self._cleared_ns >= _CLEAR_EVERY_NS


class WheelOrigin:
    """What an axis' estimates show of its motor, and from which origin.

    Firmware 0.5.6 sends the inputs of its controller, which are connected when closed-loop control begins: until then,
    after power-on, position and velocity are exactly zero wherever the wheel stands and however it turns, and then the
    position jumps to the encoder's (`get_encoder_estimates_callback`, `start_closed_loop_control`). Which versions do
    so a drive of 0.5 does not tell. So two exact zeros from an axis that was not seen in closed loop since it last may
    have restarted measure nothing; and with the first estimate that does, the position goes on from where it was.

    Attributes:
        estimates: The newest that measured the motor, counted from the origin.
        is_blind: Whether the newest measured nothing.
        is_connected: Whether the axis was in closed loop since it may have restarted, so that zeros are measured.
    """

    def __init__(self) -> None:
        """Begin with a motor of which nothing is known."""
        self.estimates = m.EncoderEstimates(0.0, 0.0)
        self.is_blind = False
        self.is_connected = False
        self._offset_rev = 0.0

    def take(self, estimates: m.EncoderEstimates, *, zeros_measure: bool) -> None:
        """Take what the axis sent; `zeros_measure` for a firmware that never sends zeros in place of a measurement."""
        position_rev, velocity_rev_s = estimates
        if not (position_rev or velocity_rev_s or zeros_measure or self.is_connected):
            self.is_blind = True
            return
        if self.is_blind:
            self.is_blind = False
            self._offset_rev = self.estimates.position_rev - position_rev
        if self._offset_rev:
            estimates = m.EncoderEstimates(position_rev + self._offset_rev, velocity_rev_s)
        self.estimates = estimates


class AxisListener:
    """Keeps the newest telemetry of one axis.

    Attributes:
        signals: What it measures, with units; the first axis measures the supply too.
        error: Error bits of the newest heartbeat, which carries the state too, see `AxisState`.
        is_uncalibrated: Whether it reported that it lacks a calibration, when it was last asked for closed loop; 0.6.
        fresh: When `heartbeat`, `estimates`, `torque` and `supply` arrived.
        origin: What the estimates show of the motor.
        causes: What is behind its errors.
        own: What it is set to, as far as that is read.
        reading: How that is read; None where no line allows it.
        gap_ns: Time between the two newest heartbeats; 0 before there were two.
    """

    def __init__(self, name: str, settings: OdriveSettings, loop_period_s: float, now_ns: NowNs) -> None:
        """Listen to the axis of the wheel called `name`."""
        is_first = name == next(iter(settings.axes))
        self.signals: Mapping[str, str] = wheel_signals(name) | ({SUPPLY_VOLTAGE: "V"} if is_first else {})
        self._wheel_signals = (f"{name}.angle", f"{name}.velocity")
        self._wheel = settings.axes[name]
        self.search = FirmwareSearch(settings.firmware, needs_release=settings.endpoints is not None)
        beat_s = max(settings.heartbeat_period_s, loop_period_s)
        # A cycle more, since what comes over a serial line is read up to one cycle late.
        self.proof = WatchdogProof(round((settings.watchdog_s + beat_s + loop_period_s) * 1e9))
        self._commands = {FrameKey(arbitration_id(self._wheel.node_id, command)): command for command in _COMMANDS}
        self.listens_to: Collection[FrameKey] = frozenset(self._commands)
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
        self.fresh = Freshness(stale_ns, now_ns, settings.ride_through_s)
        self._now_ns = now_ns
        self._beat_ns: int | None = None
        self.origin = WheelOrigin()
        self.causes = ErrorCauses()
        self.own = OwnSettings(name, settings)
        self.reading = settings_reading(name, settings, self.own)
        self._torque = 0.0
        self._supply = 0.0
        self._newest: dict[type[Any], Any] = {}

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the axis' frames; False where it was refused, which is counted."""
        command = self._commands.get((frame.arbitration_id, frame.is_extended))  # type: ignore[call-overload]  # as equal
        if command is None:
            return False
        try:
            if command == TX_SDO:
                return self._take_setting(frame.data)
            firmware = self._meaning(command)
            if firmware is None or command not in LAYOUTS[firmware]:
                return False  # what it means is not known yet, or nothing that is used here
            message = decode(firmware, frame.arbitration_id, frame.data)
        except FrameRefusedError as error:
            self.refused[error.refusal] += 1
            return False
        self._keep(message, frame.received_ns)
        return True

    def read(self) -> Readings:
        """Angle (rad), velocity (rad/s) and torque (N m) of the wheel; of the first axis the supply's voltage (V) too.

        The angle is the drive's own, which counts from power-on, or from where it stood when the drive was first seen
        to measure it (`WheelOrigin`). Its resolution is that of the wire's 32-bit float, 4e-4 rad at 1000 turns of the
        motor and 6e-3 rad at 10000.
        """
        wheel = self._wheel.wheel
        angle, velocity = motor_motion(self.origin.estimates)
        now_ns = self._now_ns()
        age, valid = (math.inf, False) if self.origin.is_blind else self.fresh.age("estimates", now_ns=now_ns)
        torque_age, torque_valid = self.fresh.age("torque", now_ns=now_ns)
        values = (wheel(angle), wheel(velocity), self._wheel.wheel_torque(self._torque))
        unseen = self._wheel_signals if self.origin.is_blind else ()
        readings = Readings(values, (age, age, torque_age), (valid, valid, torque_valid), unseen)
        if SUPPLY_VOLTAGE not in self.signals:
            return readings
        return with_one_more(readings, self._supply, self.fresh.age("supply", now_ns=now_ns))

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
            "causes": "; ".join(self.causes.found) or "none",
            "firmware": str(self.search),
            "unconfirmed_versions": str(self.search.unconfirmed),
            **self.fresh.health,
            **{f"own.{reading.name}": f"{reading.value:g}" for reading in self.own.readings},
            "watchdog_ms": "not seen" if self.proof.took_ns is None else f"{self.proof.took_ns * 1e-6:.1f}",
            "angle_resolution_rad": f"{abs(self._wheel.wheel(angle_resolution(self.origin.estimates))):.1e}",
            **newest,
        }

    def _take_setting(self, data: bytes) -> bool:
        if self.reading is None:
            return False
        self.reading.take(data)
        return True

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
                self.origin.take(message, zeros_measure=self.search.found is Firmware.V0_6)
                self.fresh.mark("estimates", received_ns)
            case m.Version():
                self._take_version(message)
            case m.MotorError() | m.EncoderError() | m.ControllerError() | m.Errors():
                self.causes.take(message)
            case m.Torques():
                self._measure(message.estimate_nm, received_ns)
            case m.BusVoltageCurrent(voltage):
                self._supply = voltage
                self.fresh.mark("supply", received_ns)
            case m.Currents() if self.search.found is Firmware.V0_5 and self._wheel.torque_constant is not None:
                self._measure(message.measured_a * self._wheel.torque_constant, received_ns)
        if type(message) in _SHOWN_IN_HEALTH:
            self._newest[type(message)] = message

    def _take_version(self, version: m.Version) -> None:
        before = self.search.found
        self.search.answer(version)
        if self.search.found is not before:
            self.proof.reset()
        if self.reading is not None and self.search.version is not None:
            self.reading.note_version(self.search.version)

    def _take_heartbeat(self, error: int, state: int, received_ns: int) -> None:
        self.error, self.state = error, state
        self.gap_ns = 0 if self._beat_ns is None else received_ns - self._beat_ns
        if self.gap_ns > self.stale_beat_ns:
            # It may have been switched off and on, with another configuration.
            self.proof.reset()
            self.origin.is_connected = False
            self.search.forget_release()
            if self.reading is not None:
                self.reading.reset()
        self._beat_ns = received_ns
        self.fresh.mark("heartbeat", received_ns)
        self.search.beat(received_ns)
        if self.search.found is not None:
            self.causes.note_errors(self.search.found, error)
            self.proof.note_heartbeat(received_ns, expired=bool(error & WATCHDOG[self.search.found]))

    def _measure(self, motor_torque: float, received_ns: int) -> None:
        self._torque = motor_torque
        self.fresh.mark("torque", received_ns)
