# SPDX-License-Identifier: MIT
"""One axis of an ODrive, which moves one wheel or joint, as a `Drive`: enable, command, disable."""

import math
import time
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.devices import FrameKey, Readings
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive
from segway_ecc.firmware_io.drives.odrive import messages as m
from segway_ecc.firmware_io.drives.odrive.frames import (
    COMMANDING,
    COMMANDS,
    ESTIMATES,
    HEARTBEAT,
    VERSION,
    Firmware,
    Message,
    arbitration_id,
    encode,
    request,
)
from segway_ecc.firmware_io.drives.odrive.listener import AxisListener
from segway_ecc.firmware_io.drives.odrive.messages import PASSTHROUGH, TORQUE_CONTROL, AxisState
from segway_ecc.firmware_io.drives.odrive.sdo import TX_SDO
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs

_ZERO = m.SetInputTorque(0.0)
_TORQUE_MODE = m.SetControllerMode(TORQUE_CONTROL, PASSTHROUGH)
_NEVER = -(1 << 62)
_RESEND_NS: Final = 50_000_000
"""A step that the axis has not confirmed is sent again after this long."""
_IN_FLIGHT_NS: Final = 5_000_000
"""What arrives this soon after a frame was sent may have been on its way before; a frame waits a few ms at the most."""
_STEPS_BITS: Final = 4_000
"""What it takes on the serial line to disable both axes and enable them again: 380 bytes of ten bits."""
_CALIBRATE = "calibrate it where it is not: stop the node, wheels in the air, FULL_CALIBRATION_SEQUENCE, save"


class Odrive(PhasedDrive):
    """One wheel on an axis of an ODrive; see `Drive`.

    An axis whose watchdog is not proved yet (`WatchdogProof`) must receive nothing for a while. "Zero is sent, not
    silence" stands for: a drive never holds an old torque because its host sent nothing. An idle axis has its motor
    switched off, so silence leaves no torque standing. That is why silence begins only once a heartbeat has shown that
    the axis is idle, and ends, with zero and idle sent again and again, when heartbeats stop or show another state.
    """

    def __init__(
        self, link: Link, name: str, settings: OdriveSettings, loop_period_s: float, now_ns: NowNs = time.monotonic_ns
    ) -> None:
        """Drive the axis called `name` over `link`, exchanged with at `loop_period_s`."""
        super().__init__(now_ns)
        self.name = name
        self.commands: Mapping[str, str] = {f"{name}.torque": "N m"}
        self._settings = settings
        self._wheel = settings.axes[name]
        self.limits: Sequence[float] = (self._wheel.max_torque,)
        self._link = link
        self._axis = AxisListener(name, settings, loop_period_s, now_ns)
        self.signals: Mapping[str, str] = self._axis.signals
        self.listens_to = self._axis.listens_to
        self.periods_s: Mapping[FrameKey, float] = {
            FrameKey(arbitration_id(self._wheel.node_id, ESTIMATES)): settings.encoder_period_s
        }
        self.commanded_by: Collection[FrameKey] = frozenset(
            FrameKey(arbitration_id(self._wheel.node_id, command)) for command in COMMANDING
        )
        beat_s = max(settings.heartbeat_period_s, loop_period_s)
        # All steps of both wheels may be on their way over the serial line.
        line_s = 0.0 if settings.serial is None else _STEPS_BITS / settings.serial.baudrate
        self._settled_ns = round((loop_period_s + line_s) * 1e9) + _IN_FLIGHT_NS
        self._resend_ns = max(_RESEND_NS, self._settled_ns + round(2e9 * beat_s))
        self._cleared: tuple[str, ...] = ()
        self._stepped_ns = _NEVER
        self._first_step_ns: int | None = None
        self._is_closed = False
        """Whether the newest heartbeat shows closed loop, and was sent after the steps to it."""
        self._silent_since_ns: int | None = None

    def start(self) -> None:
        """Send zero and idle: whatever the axis was doing, it stops."""
        self._stop()

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the axis' frames; see `Sensor.take_frame`."""
        taken = self._axis.take_frame(frame)
        if taken and frame.arbitration_id % COMMANDS == HEARTBEAT:
            self._off_ns = frame.received_ns if self._axis.state == AxisState.IDLE else None
            # What arrived sooner may have been on its way before the steps were.
            first_ns = self._first_step_ns
            is_settled = first_ns is not None and frame.received_ns - first_ns >= self._settled_ns
            self._is_closed = is_settled and self._axis.is_closed_loop
            self._axis.origin.is_connected |= self._is_closed
        # Where the wheel could not be seen before, it is enabled once an estimate shows where it stands.
        if taken and self._is_closed and not self._axis.origin.is_blind:
            self._enabling.confirm()
        return taken

    def read(self) -> Readings:
        """Angle, velocity and torque of the wheel, and for the first one the supply's voltage.

        The torque and the voltage are valid only where the drive sends them.
        """
        readings, causes = self._axis.read(), self._axis.causes
        if causes.event is None:
            return readings
        event, causes.event = f"the {self.name} ODrive axis reports {causes.event}", None
        return replace(readings, events=(event,))

    def arming_failures(self) -> list[str]:
        """Silence, an unknown firmware, no calibration, motion, or a watchdog that has not proved itself.

        Errors that stand are none: arming clears them, and those that come back end it.
        """
        axis, settings = self._axis, self._settings
        who = f"{self.name} ODrive axis (node {self._wheel.node_id})"
        if not axis.fresh.age("heartbeat")[1]:
            return [f"{who} sends no heartbeat on {self._link.description}: check power, bit rate and can.node_id"]
        if axis.search.found is None:
            return [f"{who}: its firmware is being asked for, half a second"]
        reasons = [] if axis.search.mismatch is None else [f"{who} {axis.search.mismatch}"]
        suffix = "rate_ms" if axis.search.found is Firmware.V0_5 else "msg_rate_ms"
        if axis.gap_ns > axis.stale_beat_ns:
            period_ms = f"{settings.heartbeat_period_s * 1e3:g}"
            reasons.append(
                f"{who}: heartbeats come {axis.gap_ns * 1e-6:.0f} ms apart, {period_ms} is expected; "
                f"set can.heartbeat_{suffix} = {period_ms}"
            )
        if not axis.fresh.age("estimates")[1]:
            reasons.append(
                f"{who} sends no encoder estimates, or seldom; "
                f"set can.encoder_{suffix} = {settings.encoder_period_s * 1e3:g}"
            )
        if axis.is_uncalibrated:
            reasons.append(f"{who} is not calibrated; {_CALIBRATE}")
        if self._enabling.phase is Phase.OFF and axis.state != AxisState.IDLE:
            reasons.append(f"{who} is in {axis.state_name}, and is being set to idle; try again in a moment")
        return reasons + self._watchdog_failures(who) + self._setting_failures(who)

    @property
    def readings(self) -> Sequence[DriveReading]:
        """What was read back of the axis' own settings; see `ReportsSettings`."""
        return self._axis.own.readings

    def take_standby_frame(self, frame: Frame) -> None:
        """Take a frame of the line in standby: a setting, which that line reads by itself; see `StandbyListener`."""
        if frame.arbitration_id % COMMANDS == TX_SDO:
            self._axis.take_frame(frame)

    @property
    def is_off(self) -> bool:
        """Whether a heartbeat, fresh and received after the command to disable, reports that the axis is idle.

        In every other state the motor may have current: closed loop is one, calibration and homing are others.
        """
        return self._enabling.confirms_disable(self._off_ns) and self._axis.fresh.age("heartbeat")[1]

    def enable(self) -> None:
        """Send the steps to closed loop from the next cycle, with zero, until a heartbeat confirms it."""
        self._enabling.begin(self._now_ns())
        self._first_step_ns = None
        self._is_closed = False
        self._stepped_ns = _NEVER

    def command(self, commands: Sequence[float]) -> None:
        """Send the torque, N m at the wheel, where the axis follows commands, else zero or the next step."""
        match self._enabling.phase:
            case Phase.ENABLED:
                # An axis that no longer follows commands gets zero.
                wanted = commands[0] if self._axis.is_closed_loop and math.isfinite(commands[0]) else 0.0
                limited = min(max(wanted, -self._wheel.max_torque), self._wheel.max_torque)
                self._send(m.SetInputTorque(self._wheel.motor_torque(limited)))
            case Phase.ENABLING:
                self._step()
            case Phase.OFF:
                self._rest()
                return
        self._ask_causes()

    def disable(self) -> None:
        """Send zero and idle."""
        self._enabling.end(self._now_ns())
        self._stop()

    def faults(self) -> tuple[str, ...]:
        """Errors, a motor switched off by itself or not switched on, silence."""
        axis, who, now_ns = self._axis, f"the {self.name} ODrive axis", self._now_ns()
        if self._enabling.is_overdue(now_ns):
            why = self._why_off()
            return (f"{who} does not go to closed loop: {why}; see dump_errors in odrivetool, and {_CALIBRATE}",)
        if not self.is_enabled:
            return ()
        found = [] if axis.is_closed_loop else [f"{who} switched its motor off: {self._why_off()}"]
        for kind in ("heartbeat", "estimates"):
            age_s, valid = axis.fresh.age(kind, now_ns=now_ns)
            if not valid:
                found.append(f"{who}'s {kind} too old: {age_s * 1e3:.0f} ms")
        return tuple(found)

    @property
    def health(self) -> Mapping[str, str]:
        """What the axis reports, and the errors that the last clearing found."""
        return {**self._axis.health, "cleared": ", ".join(self._cleared) or "none"}

    def _why_off(self) -> str:
        """What the axis reports where its motor is off."""
        causes = self._axis.causes.found if self._axis.error else ()
        because = f"; causes: {'; '.join(causes)}" if causes else ""
        return f"{self._axis.state_name}, errors: {', '.join(self._axis.errors) or 'none'}{because}"

    def _ask_causes(self) -> None:
        """Ask what is behind an error that stands; that feeds the watchdog of 0.5, as the commands beside it do."""
        command = self._axis.causes.next_request(self._now_ns())
        if command is not None:
            self._put(request(self._wheel.node_id, command))

    def _watchdog_failures(self, who: str) -> list[str]:
        """What the proof of the watchdog lacks."""
        proof, wanted_s = self._axis.proof, self._settings.watchdog_s
        if proof.is_proven:
            return []
        within = f"{proof.within_ns * 1e-6:.0f}"
        remedy = f"set config.enable_watchdog = True and config.watchdog_timeout = {wanted_s:g}, save and restart it"
        if proof.took_ns is not None:
            return [f"{who}: its watchdog took {proof.took_ns * 1e-6:.0f} ms, allowed is {within}; {remedy}"]
        silent_ns = 0 if self._silent_since_ns is None else self._now_ns() - self._silent_since_ns
        if silent_ns > proof.within_ns and proof.is_expired:
            return [
                f"{who}: its watchdog expires before a heartbeat can show it; watchdog_timeout = {wanted_s:g} does not"
            ]
        if silent_ns > proof.within_ns:
            return [f"{who}: its watchdog was not seen to expire in {silent_ns * 1e-6:.0f} ms of silence; {remedy}"]
        return [f"{who}: its watchdog is being tried, up to {within} ms of silence"]

    def _setting_failures(self, who: str) -> list[str]:
        """Settings of the drive that do not fit, or are still to be read."""
        axis = self._axis
        if axis.reading is None or axis.search.found is None:
            return []
        failures = [f"{who}: {text}" for text in axis.reading.arming_failures()]
        if axis.reading.waits(self._now_ns()):
            failures.append(f"{who}: its settings are being read; try again in a moment")
        return failures + axis.own.arming_failures(axis.search.found, who)

    def _step(self) -> None:
        """All steps to closed loop in their order, now and then until confirmed; in between zero, which feeds.

        The error of a watchdog that is not fed comes back at once, so zero goes out before the errors are cleared.
        """
        now_ns = self._now_ns()
        if now_ns - self._stepped_ns < self._resend_ns:
            self._send(_ZERO)
            return
        if self._first_step_ns is None:
            self._first_step_ns = now_ns
        self._stepped_ns = now_ns
        self._send(_TORQUE_MODE)
        self._send(_ZERO)
        self._clear()
        self._send(m.SetAxisState(AxisState.CLOSED_LOOP_CONTROL))

    def _rest(self) -> None:
        """Keep the axis idle, find out what it is, and let its watchdog prove itself."""
        axis, now_ns = self._axis, self._now_ns()
        if self._silent_since_ns is None:  # before an error is cleared, and never into a silence
            self._ask_causes()
        if not axis.fresh.age("heartbeat")[1] or axis.state != AxisState.IDLE:
            self._send(_ZERO)
            if now_ns - self._stepped_ns >= self._resend_ns:
                self._stepped_ns = now_ns
                self._send(m.SetAxisState(AxisState.IDLE))
        elif axis.search.found is None or axis.proof.is_proven:
            self._send(_ZERO)
        elif axis.proof.needs_clearing(now_ns):
            self._send(_ZERO)
            self._clear()
            axis.proof.clear(now_ns)
        elif self._silent_since_ns is None:
            self._silent_since_ns = now_ns
        if axis.search.should_ask(now_ns):
            self._put(request(self._wheel.node_id, VERSION))
        # Any frame may feed a watchdog, so it proves itself first.
        elif axis.reading is not None and axis.proof.is_proven:
            asked = axis.reading.next_request(now_ns)
            if asked is not None:
                self._put(asked)

    def _stop(self) -> None:
        self._stepped_ns = self._now_ns()
        self._send(_ZERO)
        self._send(m.SetAxisState(AxisState.IDLE))

    def _clear(self) -> None:
        self._cleared = self._axis.errors or self._cleared
        self._send(m.ClearAxisErrors() if self._axis.search.found is Firmware.V0_6 else m.ClearErrors())

    def _send(self, command: Message) -> None:
        self._put(encode(self._axis.search.found or Firmware.V0_5, self._wheel.node_id, command))

    def _put(self, frame: Frame) -> None:
        self._link.send(frame)
        self._axis.proof.feed()
        self._silent_since_ns = None
