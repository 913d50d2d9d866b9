# SPDX-License-Identifier: MIT
"""One axis behind a moteus controller as a `Drive`: torque in, angle, velocity and torque out."""

import contextlib
import math
from collections.abc import Collection, Generator, Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.devices import SUPPLY_VOLTAGE, TURN, FrameKey, Freshness, stale_after_ns
from segway_ecc.firmware_io.drives.axis import REPORT, ReportingAxis
from segway_ecc.firmware_io.drives.enabling import Phase
from segway_ecc.firmware_io.drives.moteus import frames as moteus
from segway_ecc.firmware_io.drives.moteus.settings import MoteusSettings
from segway_ecc.firmware_io.links.link import Frame, Link, NowNs

_WRAP: Final = 65_536.0
"""Turns after which a controller's position begins again: it has 16 bits of them (fw/motor_position.h, 2026)."""
_TIMEOUT_WITHIN_S: Final = 1.5e-3  # it reports its time-out in whole milliseconds, cut off
_REQUIRED: Final = {
    "servo.timeout_mode": ("0", "without commands it would hold or brake the wheel, and not let it go"),
    "servopos.position_min": ("nan", "beyond it there is no torque"),
    "servopos.position_max": ("nan", "beyond it there is no torque"),
    "servo.pid_position.ilimit": ("0", "the integral of the position's error would add to the torque"),
    "servo.inertia_feedforward": ("0", "it would add to the torque"),
}
"""What its configuration must be, and why (BldcServoConfig and bldc_servo_control.h, 2026)."""
_ASKED_AGAIN: Final = 20  # answers without a whole line, after which one was lost


class Moteus(ReportingAxis):
    """One axis; see `Drive`.

    A controller sends nothing by itself: each command asks for an answer, which is there in the next cycle. An axis
    that is off is stopped in every cycle, which also takes it out of a fault or its time-out.
    """

    def __init__(self, link: Link, name: str, settings: MoteusSettings, loop_period_s: float, now_ns: NowNs) -> None:
        """Drive the axis `name` over `link`, exchanged with at `loop_period_s`."""
        axis = settings.axes[name]
        stale_ns = stale_after_ns(loop_period_s, loop_period_s)
        super().__init__(link, name, axis, Freshness({REPORT: stale_ns}, now_ns, settings.ride_through_s), now_ns)
        if name == next(iter(settings.axes)):
            self.signals = {**self.signals, SUPPLY_VOLTAGE: "V"}
        self._id, self._timeout_s, self._largest = (
            axis.servo_id,
            settings.watchdog_s,
            axis.motor_torque(axis.max_torque),
        )
        self._title = f"the {name} moteus (id {self._id})"
        self._silence = (
            f"{self._title} does not answer on {link.description}; is it powered and on this bus, with can.prefix 0, "
            "and has the bus moteus' bit rates and sample points?"
        )
        reply = moteus.route(self._id, moteus.HOST)
        self.listens_to: Collection[FrameKey] = (reply, moteus.route(self._id, moteus.ASIDE))
        self.periods_s: Mapping[FrameKey, float] = {reply: loop_period_s}
        self.commanded_by: Collection[FrameKey] = frozenset(
            moteus.route(source, to) for source in range(256) for to in (self._id, moteus.BROADCAST)
        )
        self._reply, self._turns, self._last_fault = moteus.NOTHING, 0.0, "none"
        self._begin_reading()

    def start(self) -> None:
        """Stop it."""
        self._send(moteus.HOST, moteus.stop_command(self._timeout_s))

    def arming_failures(self) -> list[str]:
        """Silence, a time-out that is not the one that is sent, or a configuration that is not as it must be."""
        if not self._is_fresh:
            return [self._silence]
        if abs(self._reply.timeout_s - self._timeout_s) > _TIMEOUT_WITHIN_S:
            return [f"{self._title} has a time-out of {self._reply.timeout_s:g} s, not of {self._timeout_s:g} s"]
        if self._question is not None:
            return [f"the configuration of {self._title} is being read; try again in a moment"]
        return [
            f"{name} of {self._title} is {self._found[name]}, not {wanted}: {why}; "
            f"in moteus_tool --console: conf set {name} {wanted}, then conf write"
            for name, (wanted, why) in _REQUIRED.items()
            if self._found[name] != wanted
        ]

    def enable(self) -> None:
        """Command position mode, with no torque until the controller is in it."""
        self._enabling.begin(self._now_ns())

    def command(self, commands: Sequence[float]) -> None:
        """Send the torque, N m, where the axis is enabled; zero while it is being enabled; else stop it."""
        if self._enabling.phase is not Phase.OFF:
            torque = self._motor_torque(commands[0] if self.is_enabled else 0.0)
            self._send(moteus.HOST, moteus.torque_command(torque, abs(self._largest), self._timeout_s))
            return
        self.start()
        if not self._is_fresh:
            self._begin_reading()  # what comes back may be another controller
        elif self._question is not None:
            self._send(moteus.ASIDE, self._question)

    def disable(self) -> None:
        """Stop it, twice: to the second the controller answers that it is off, which the guard waits for."""
        self._enabling.end(self._now_ns())
        for wants_reply in (False, True):
            self._send(moteus.ASIDE, moteus.stop_command(self._timeout_s), wants_reply=wants_reply)

    def faults(self) -> tuple[str, ...]:
        """A controller that is silent, in a fault, or in another mode than the one that is commanded."""
        if self._enabling.phase is Phase.OFF:
            return ()
        if not self._is_fresh:
            return (self._silence,)
        if self._reply.mode == moteus.FAULT:
            return (f"{self._title} reports {self._last_fault}",)
        if self._enabling.is_overdue(self._now_ns()) or (self.is_enabled and self._reply.mode != moteus.POSITION):
            return (f"{self._title} does not follow: its mode is {moteus.MODES[self._reply.mode]}",)
        return ()

    @property
    def health(self) -> Mapping[str, str]:
        """What the controller reports, and what was refused of it."""
        return {
            **self._refusals,
            "phase": str(self._enabling.phase),
            "mode": moteus.MODES[self._reply.mode],
            "last_fault": self._last_fault,
            "bus_voltage_v": f"{self._reply.voltage:.1f}",
            "temperature_c": f"{self._reply.temperature:.1f}",
            **self._found,
            **self._fresh.health,
        }

    def _take(self, frame: Frame) -> None:
        if frame.data.startswith(moteus.TEXT):
            self._question = self._conversation.send(moteus.decode_text(frame))
            return
        reply = moteus.decode_reply(frame)
        self._turns += math.remainder(reply.position - self._reply.position, _WRAP)
        self._reply, self._supply = reply, reply.voltage
        if reply.mode == moteus.FAULT:
            self._last_fault = moteus.fault_name(reply.fault)
        motor = (self._turns * TURN, reply.velocity * TURN, reply.torque)
        is_off, follows = reply.mode in moteus.OFF, reply.mode == moteus.POSITION
        self._report(motor, frame.received_ns, is_off=is_off, follows=follows)

    def _begin_reading(self) -> None:
        self._found: dict[str, str] = {}
        self._conversation = _read_configuration(self._found)
        self._question = next(self._conversation)

    def _send(self, source: int, data: bytes, *, wants_reply: bool = True) -> None:
        self._link.send(moteus.frame_to(moteus.route(source, self._id, wants_reply=wants_reply), data))


def _read_configuration(found: dict[str, str]) -> Generator[bytes | None, bytes, None]:
    """Yields what to send, None at the end, and is sent what the console answered; fills `found` by name."""
    for name in _REQUIRED:
        while (yield moteus.POLL_TEXT):
            pass  # left over from a conversation with somebody else
        text, answers = b"", 0
        while b"\n" not in text:
            is_asked = answers % _ASKED_AGAIN == 0
            answer = yield moteus.console_line(f"conf get {name}") if is_asked else moteus.POLL_TEXT
            text, answers = (b"" if is_asked else text) + answer, answers + 1
        found[name] = text.partition(b"\n")[0].decode("ascii", "replace").strip()
        with contextlib.suppress(ValueError):
            found[name] = f"{float(found[name]):g}"
    while True:
        yield None
