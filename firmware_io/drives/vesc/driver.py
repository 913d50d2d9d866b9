# SPDX-License-Identifier: MIT
"""One wheel or joint behind a VESC as a `Drive`: motor current in, speed, angle and torque out."""

import math
import time
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.devices import (
    SUPPLY_STALE_NS,
    SUPPLY_VOLTAGE,
    FrameKey,
    Freshness,
    Readings,
    WrappedCounter,
    stale_after_ns,
    with_one_more,
)
from segway_ecc.firmware_io.drives.enabling import Phase, PhasedDrive, wheel_signals
from segway_ecc.firmware_io.drives.readings import DriveReading
from segway_ecc.firmware_io.drives.vesc.condition import (
    FAULT,
    FLAGS,
    Found,
    Step,
    TimeoutProbe,
    answer,
    ask,
    fault_name,
)
from segway_ecc.firmware_io.drives.vesc.frames import (
    BROADCAST_ID,
    COMMANDING,
    Comm,
    Current,
    PacketId,
    Status,
    Status5,
    arbitration_id,
    decode,
    frame_of,
    motor_angle,
)
from segway_ecc.firmware_io.drives.vesc.limits import LimitsReading
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketAssembler, ShortBuffer, decode_short, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs

_ASK_EVERY_NS: Final = 100_000_000
"""A fault lasts half a second, so none is missed."""
_WAITS_NS: Final = 100_000_000
"""How long after the next one a controller is asked for its limits, the last one at once. An answer of 74 frames takes
20 ms at 500 kbit/s and comes before STATUS; where two answer at once, STATUS is held up for so long that it counts as
silent."""
_CURRENT_STEP: Final = 0.1
"""The resolution of the motor current in STATUS, A."""
_OFF_CURRENT: Final = 0.5
"""Up to this measured motor current, A, the motor counts as off.

A VESC reports no state. With zero asked for it releases the motor, and what is measured is the offset and noise of
its current sensors, a few steps of about 0.1 A. A motor that a robot leans on takes several ampere.
"""
_OFF_SHARE: Final = 0.1
"""Of the wheel's largest current, where that is so small that the above would hide a torque that matters."""
_TELEMETRY: Final = (PacketId.STATUS, PacketId.STATUS_5)
_SETUP: Final = "in VESC Tool, App Settings > General, set Timeout to {ms:.0f} ms and Timeout Brake Current to 0 A"


class Vesc(PhasedDrive):
    """One wheel; see `Drive`.

    A VESC has no state that it must be brought into: it follows every command. So zero is sent in every cycle unless
    it is enabled, and it counts as enabled once STATUS and STATUS_5 have arrived after the first zero.
    """

    def __init__(
        self, link: Link, name: str, settings: VescSettings, loop_period_s: float, now_ns: NowNs = time.monotonic_ns
    ) -> None:
        """Drive the axis called `name` over `link`."""
        super().__init__(now_ns)
        wheel, names = settings.axes[name], list(settings.axes)
        self.name = name
        self.signals: Mapping[str, str] = wheel_signals(name) | ({SUPPLY_VOLTAGE: "V"} if name == names[0] else {})
        self.commands: Mapping[str, str] = {f"{name}.torque": "N m"}
        self.limits: Sequence[float] = (wheel.max_torque,)
        self._link = link
        self._wheel = wheel
        self._timeout_s = settings.timeout_set_s
        self._rate_hz = settings.status_rate_hz
        self._host_id = settings.host_ids[name]
        self._answers_id = arbitration_id(PacketId.PROCESS_SHORT_BUFFER, self._host_id)
        buffers = (PacketId.FILL_RX_BUFFER, PacketId.FILL_RX_BUFFER_LONG, PacketId.PROCESS_RX_BUFFER)
        self._buffers = {arbitration_id(kind, self._host_id): kind for kind in buffers}
        self._kinds = {arbitration_id(kind, wheel.controller_id): kind for kind in _TELEMETRY}
        self.listens_to: Collection[FrameKey] = frozenset(
            FrameKey(identifier, is_extended=True) for identifier in (*self._kinds, *self._buffers, self._answers_id)
        )
        self.periods_s: Mapping[FrameKey, float] = {
            FrameKey(identifier, is_extended=True): 1.0 / settings.status_rate_hz for identifier in self._kinds
        }
        self.commanded_by: Collection[FrameKey] = frozenset(
            FrameKey(arbitration_id(packet, to), is_extended=True)
            for packet in COMMANDING
            for to in (wheel.controller_id, BROADCAST_ID)
        )
        stale_ns = stale_after_ns(1.0 / settings.status_rate_hz, loop_period_s)
        asked_ns = stale_after_ns(_ASK_EVERY_NS * 1e-9, loop_period_s)
        self._fresh = Freshness(
            {**dict.fromkeys(_TELEMETRY, stale_ns), PacketId.PROCESS_SHORT_BUFFER: asked_ns},
            now_ns,
            settings.ride_through_s,
        )
        self._refused: Counter[str] = Counter()
        self._status = Status(0.0, 0.0, 0.0)
        self._bus_voltage = 0.0
        self._counter = WrappedCounter(32)
        self._fault = 0
        self._asked_ns: int | None = None
        self._probe = TimeoutProbe(settings.timeout_set_s)
        self._assembler = PacketAssembler()
        wait_ns = _WAITS_NS * (len(names) - 1 - names.index(name))
        has_fallback = settings.serial is not None
        self._limits = LimitsReading(self._title, wheel.max_current, wait_ns, has_fallback=has_fallback)
        self._zero_ns: int | None = None
        """When the first zero since `enable` was sent."""
        self._confirmed: set[PacketId] = set()
        self._off_current = min(_OFF_CURRENT, max(_CURRENT_STEP, _OFF_SHARE * wheel.max_current))

    def start(self) -> None:
        """Send zero."""
        self._send_torque(0.0)

    def take_frame(self, frame: Frame) -> bool:
        """Take one of the controller's frames; see `Sensor.take_frame`."""
        if FrameKey(frame.arbitration_id, frame.is_extended) not in self.listens_to:
            return False
        try:
            if frame.arbitration_id == self._answers_id:
                self._take_answer(decode_short(frame.data), frame.received_ns)
            elif frame.arbitration_id in self._buffers:
                packet = self._assembler.take(self._buffers[frame.arbitration_id], frame.data)
                if packet is not None:
                    self._take_answer(packet, frame.received_ns)
            else:
                self._take_status(self._kinds[frame.arbitration_id], frame)
        except FrameRefusedError as error:
            self._refused[error.refusal] += 1
            return False
        return True

    def read(self) -> Readings:
        """The wheel's angle, velocity and torque, and of the first controller the supply's voltage."""
        angle = self._wheel.wheel(motor_angle(self._counter.total, self._wheel.pole_pairs))
        velocity = self._wheel.wheel(self._status.motor_velocity(self._wheel.pole_pairs))
        torque = self._wheel.wheel_torque(self._status.directed_current() * self._wheel.torque_constant)
        age, is_valid = self._fresh.age(PacketId.STATUS)
        angle_age, angle_is_valid = self._fresh.age(PacketId.STATUS_5)
        readings = Readings(
            (angle, velocity, torque),
            (angle_age, age, age),
            (angle_is_valid, is_valid, is_valid),
        )
        if SUPPLY_VOLTAGE not in self.signals:
            return readings
        return with_one_more(readings, self._bus_voltage, self._fresh.age(PacketId.STATUS_5, SUPPLY_STALE_NS))

    def arming_failures(self) -> list[str]:
        """Silence, a time-out that does not act or has not been measured yet, limits too low, or a fault."""
        if not all(self._fresh.age(kind)[1] for kind in _TELEMETRY):
            return [self._silence]
        reasons = []
        if self._probe.found is Found.NOTHING:
            reasons.append(f"the time-out of {self._title} is being measured; try again in a moment")
        if self._probe.found is Found.DOES_NOT_ACT:
            reasons.append(
                f"{self._title} did not time out within {self._probe.silence_s * 1e3:.0f} ms without a command; "
                + _SETUP.format(ms=self._timeout_s * 1e3)
            )
        reasons += self._limits.arming_failures()
        fault = self._fresh_fault
        if fault:
            reasons.append(f"{self._title} reports {fault_name(fault)}; remove its cause")
        return reasons

    @property
    def is_off(self) -> bool:
        """Whether STATUS, fresh and received after zero was commanded, measures next to no current in the motor."""
        return self._enabling.confirms_disable(self._off_ns) and self._fresh.age(PacketId.STATUS)[1]

    def enable(self) -> None:
        """Send zero until the controller's telemetry shows that it is there."""
        self._probe.break_off()
        self._zero_ns = None
        self._confirmed.clear()
        self._enabling.begin(self._now_ns())

    def command(self, commands: Sequence[float]) -> None:
        """Send the torque, N m, where the wheel is enabled, else zero; ask for faults now and then."""
        phase = self._enabling.phase
        if phase is Phase.OFF:
            self._rest()
        else:
            self._send_torque(commands[0] if phase is Phase.ENABLED else 0.0)
        now_ns = self._now_ns()
        if phase is Phase.ENABLING and self._zero_ns is None:
            self._zero_ns = now_ns
        if self._asked_ns is None or now_ns - self._asked_ns >= _ASK_EVERY_NS:
            self._asked_ns = now_ns
            self._link.send(ask(self._host_id, self._wheel.controller_id, FAULT))

    def disable(self) -> None:
        """Send zero: the motor coasts."""
        self._enabling.end(self._now_ns())
        self._probe.break_off()
        self._send_torque(0.0)

    def faults(self) -> tuple[str, ...]:
        """A controller that reports a fault, does not show itself, or has fallen silent."""
        if self._enabling.phase is Phase.OFF:
            return ()
        fault = self._fresh_fault
        if fault:
            return (f"{self._title} reports {fault_name(fault)}",)
        if self._enabling.is_overdue(self._now_ns()):
            return (self._silence,)
        stale = [(kind.name, age) for kind in _TELEMETRY for age, is_valid in [self._fresh.age(kind)] if not is_valid]
        if stale and self.is_enabled:
            return tuple(f"{kind} of {self._title} is too old: {age * 1e3:.0f} ms" for kind, age in stale)
        return ()

    @property
    def readings(self) -> Sequence[DriveReading]:
        """The currents that the controller allows; see `ReportsSettings`."""
        limits = self._limits.limits
        if limits is None:
            return ()
        return (
            DriveReading(f"{self.name}_least_current_a", limits.motor_min, "A"),
            DriveReading(f"{self.name}_most_current_a", limits.motor_max, "A"),
            DriveReading(f"{self.name}_least_input_current_a", limits.input_min, "A"),
            DriveReading(f"{self.name}_most_input_current_a", limits.input_max, "A"),
        )

    @property
    def health(self) -> Mapping[str, str]:
        """What the controller reports, and what was refused of it."""
        fault = self._fresh_fault
        measured = f", acts within {self._probe.silence_s * 1e3:.0f} ms" if self._probe.found is Found.ACTS else ""
        return {
            **{f"refused.{cause}": str(count) for cause, count in self._refused.items()},
            "phase": str(self._enabling.phase),
            "timeout_set_s": f"{self._timeout_s:g}",
            "timeout": f"{self._probe.found}{measured}",
            "fault": "not reported" if fault is None else fault_name(fault) if fault else "none",
            "firmware": self._limits.description,
            "unconfirmed_versions": str(self._limits.unconfirmed),
            "bus_voltage_v": f"{self._bus_voltage:.1f}",
            **self._fresh.health,
            "current_a": f"{self._status.current:.1f}",
        }

    @property
    def _title(self) -> str:
        return f"the {self.name} VESC (id {self._wheel.controller_id})"

    @property
    def _fresh_fault(self) -> int | None:
        """The newest fault code, 0 for none; None where the controller has not reported one lately."""
        return self._fault if self._fresh.age(PacketId.PROCESS_SHORT_BUFFER)[1] else None

    @property
    def _silence(self) -> str:
        silent = [kind.name for kind in _TELEMETRY if not self._fresh.age(kind)[1]]
        names = " and ".join(silent or (kind.name for kind in _TELEMETRY))
        return (
            f"{self._title} does not send {names} on {self._link.description}; is it powered and on this bus? "
            f"{_SETUP.format(ms=self._timeout_s * 1e3)}, and CAN status messages 1 and 5 to {self._rate_hz:g} Hz"
        )

    def _take_answer(self, packet: ShortBuffer, received_ns: int) -> None:
        """Take what the controller answered: its firmware and limits, its fault, or whether it has timed out."""
        if packet.packet[0] in (Comm.FW_VERSION, Comm.GET_MCCONF):
            if packet.sender_id != self._wheel.controller_id:
                raise FrameRefusedError(Refusal.UNKNOWN, f"packet from {packet.sender_id}")
            self._limits.take(packet.packet)
            return
        reply = answer(packet, self._wheel.controller_id)
        if reply.fault is None:
            self._probe.note_answer(reply.timed_out, received_ns)
        else:
            self._fault = reply.fault
            self._fresh.mark(PacketId.PROCESS_SHORT_BUFFER, received_ns)

    def _take_status(self, kind: PacketId, frame: Frame) -> None:
        payload = decode(kind, frame.data)
        if kind is PacketId.STATUS:
            self._status = Status._make(payload)
            self._off_ns = frame.received_ns if abs(self._status.current) <= self._off_current else None
        else:
            status = Status5._make(payload)
            self._bus_voltage = status.bus_voltage
            self._counter.follow(status.tachometer)
        self._fresh.mark(kind, frame.received_ns)
        if self._zero_ns is not None and frame.received_ns > self._zero_ns:
            self._confirmed.add(kind)
            if len(self._confirmed) == len(_TELEMETRY):
                self._enabling.confirm()

    def _rest(self) -> None:
        """Send zero with the motor off, or measure the time-out by silence; read the limits."""
        if not self._fresh.age(PacketId.STATUS)[1]:
            self._probe.reset()
            self._limits.reset()
        elif (question := self._limits.next_question(self._now_ns())) is not None:
            controller_id = self._wheel.controller_id
            self._link.send(frames_of(controller_id, self._host_id, Mode.PROCESS, question)[0])
        match self._probe.step(self._now_ns()):
            case Step.ZERO:
                self._send_torque(0.0)
            case Step.ASK:
                self._link.send(ask(self._host_id, self._wheel.controller_id, FLAGS))

    def _send_torque(self, torque: float) -> None:
        """Send the motor current for a torque at the wheel, N m."""
        limit = self._wheel.max_torque
        if not math.isfinite(torque):
            self._refused[Refusal.RANGE] += 1
            torque = 0.0
        motor = self._wheel.motor_torque(min(max(torque, -limit), limit))
        current = Current(motor / self._wheel.torque_constant)
        self._link.send(frame_of(PacketId.SET_CURRENT, self._wheel.controller_id, current))
