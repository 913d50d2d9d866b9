# SPDX-License-Identifier: MIT
"""What a controller is and which currents it allows: asked for before arming, and compared with the robot file.

A version is believed once it was answered twice equally: a short answer comes in one frame without a checksum, so that
a frame of a stranger may read as one, and the version decides how the limits are read. These come with a checksum.

FW_VERSION answers major, minor and the hardware's name, ended by a zero. GET_MCCONF answers the motor configuration as
the firmware's generated code writes it, which differs from version to version: a signature, four bytes of modes, then
the limits of motor current and of input current. Source: confgenerator.c of github.com/vedderb/bldc at 6.00, and its
order of fields at 6.05; the currents stand first in both. A layout that was not read is not guessed.
"""

import math
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

from segway_ecc.firmware_io.drives.vesc.frames import Comm
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal

_ASK_EVERY_NS: Final = 50_000_000
_TRIES: Final = 3
_LEAST_VERSION: Final = 3
"""Bytes of an answer to FW_VERSION: older firmware ends it after the numbers."""
_CURRENTS: Final = struct.Struct(">IBBBBffff")
_LAYOUTS: Final = {(6, 0): _CURRENTS, (6, 5): _CURRENTS}
"""Where the limits stand, by version of the firmware."""
_RANGE_A: Final = 10_000.0


class FirmwareVersion(NamedTuple):
    """The firmware, and the hardware that it was built for."""

    major: int
    minor: int
    hardware: str = ""

    def __str__(self) -> str:
        return f"{self.major}.{self.minor:02d}" + (f" on {self.hardware}" if self.hardware else "")


class CurrentLimits(NamedTuple):
    """Largest and smallest motor current, and input current, A; the smallest are negative, and brake."""

    motor_max: float
    motor_min: float
    input_max: float
    input_min: float


def decode_version(packet: bytes) -> FirmwareVersion:
    """The answer to FW_VERSION; FrameRefusedError where it is another packet, or too short."""
    if packet[:1] != bytes((Comm.FW_VERSION,)):
        raise FrameRefusedError(Refusal.UNKNOWN, "answer")
    if len(packet) < _LEAST_VERSION:
        raise FrameRefusedError(Refusal.LENGTH, f"FW_VERSION of {len(packet)} bytes")
    name = packet[_LEAST_VERSION:].partition(b"\0")[0]
    return FirmwareVersion(packet[1], packet[2], "".join(c for c in name.decode("ascii", "replace") if c.isprintable()))


def decode_limits(version: FirmwareVersion, packet: bytes) -> CurrentLimits:
    """The limits in the answer to GET_MCCONF.

    Raises:
        FrameRefusedError: It is another packet, too short, of a version whose layout is not known, or a limit has the
            wrong sign or cannot be one.
    """
    layout = _LAYOUTS.get((version.major, version.minor))
    if packet[:1] != bytes((Comm.GET_MCCONF,)) or layout is None:
        raise FrameRefusedError(Refusal.UNKNOWN, "answer")
    if len(packet) <= layout.size:
        raise FrameRefusedError(Refusal.LENGTH, f"GET_MCCONF of {len(packet)} bytes")
    limits = CurrentLimits._make(layout.unpack_from(packet, 1)[-4:])
    highest, lowest = (limits.motor_max, limits.input_max), (limits.motor_min, limits.input_min)
    if not (all(0.0 <= value <= _RANGE_A for value in highest) and all(-_RANGE_A <= value <= 0.0 for value in lowest)):
        raise FrameRefusedError(Refusal.RANGE, "GET_MCCONF")
    return limits


class LimitsReading:
    """Asks one controller for its firmware and limits, a question at a time, each three times at the most.

    Attributes:
        version: Its firmware; None where it has not answered.
        limits: Its limits; None where they are not known.
        unconfirmed: Versions that were discarded, since the next answer was another.
    """

    __slots__ = (
        "_asked_ns",
        "_first_ns",
        "_has_fallback",
        "_heard",
        "_is_refused",
        "_needed",
        "_title",
        "_tries",
        "_wait_ns",
        "limits",
        "unconfirmed",
        "version",
    )

    def __init__(self, title: str, needed_a: float, wait_ns: int = 0, *, has_fallback: bool = False) -> None:
        """Read them of the controller called `title`, whose wheel's largest torque takes this motor current, A.

        The first question is sent so long after it could be, so that two controllers do not answer at once. Where the
        robot `has_fallback`, another line, limits are not asked for: the answer's 74 frames hold STATUS up for longer
        than a line may be silent, so that the robot would change to the other one.
        """
        self._has_fallback = has_fallback
        self._title = title
        self._needed = needed_a
        self._wait_ns = wait_ns
        self.unconfirmed = 0
        self.reset()

    def reset(self) -> None:
        """Begin anew: the controller may be another one."""
        self.version: FirmwareVersion | None = None
        self.limits: CurrentLimits | None = None
        self._is_refused = False
        self._tries = 0
        self._heard: FirmwareVersion | None = None
        self._first_ns: int | None = None
        """When the first question is to be sent."""
        self._asked_ns: int | None = None

    @property
    def is_over(self) -> bool:
        """Whether nothing more is to be asked."""
        is_known = self._is_known and not (self._has_fallback and self.version is not None)
        return self.limits is not None or self._is_refused or not is_known or self._tries > _TRIES

    @property
    def _is_known(self) -> bool:
        """Whether the layout of its configuration is known, as far as its version is."""
        return self.version is None or self.version[:2] in _LAYOUTS

    def next_question(self, now_ns: int) -> bytes | None:
        """The packet to send now; None where there is none, or an answer is waited for."""
        if self._first_ns is None:
            self._first_ns = now_ns + self._wait_ns
        is_waiting = self._asked_ns is not None and now_ns - self._asked_ns < _ASK_EVERY_NS
        if self.is_over or now_ns < self._first_ns or is_waiting:
            return None
        self._asked_ns = now_ns
        self._tries += 1
        if self._tries > _TRIES:
            return None
        return bytes((Comm.FW_VERSION if self.version is None else Comm.GET_MCCONF,))

    def take(self, packet: bytes) -> None:
        """Take an answer; FrameRefusedError where it is none that was waited for."""
        if self.version is None:
            version = decode_version(packet)
            if version == self._heard:
                self.version = version
            else:
                self.unconfirmed += self._heard is not None
                self._heard = version
        else:
            try:
                self.limits = decode_limits(self.version, packet)
            except FrameRefusedError as error:
                self._is_refused = self._is_refused or error.refusal is Refusal.RANGE
                raise
        self._tries = 0
        self._asked_ns = None

    def arming_failures(self) -> Sequence[str]:
        """That it is being asked, or allows less current than the robot file's torque takes."""
        if not self.is_over:
            return [f"the firmware and limits of {self._title} are being read; try again in a moment"]
        limits = self.limits
        if limits is None:
            return []
        least = min(limits.motor_max, -limits.motor_min)
        if least >= self._needed or math.isclose(least, self._needed, rel_tol=1e-3):
            return []
        failure = (
            f"{self._title} allows {limits.motor_max:g} A of motor current and {-limits.motor_min:g} A to brake, "
            f"max_torque takes {self._needed:.3g} A: it would cut the torque and not report it; in VESC Tool, Motor "
            "Settings > General > Current, raise Motor Current Max and Motor Current Max Brake, or lower max_torque"
        )
        return [failure]

    @property
    def description(self) -> str:
        """What was read, for people."""
        if self.version is None:
            return "did not answer FW_VERSION" if self.is_over else "being asked"
        if not self._is_known:
            known = ", ".join(str(FirmwareVersion(*version)) for version in _LAYOUTS)
            return f"{self.version}; its limits are not read, their place is known for {known}: see VESC Tool"
        if self._has_fallback:
            return f"{self.version}; its limits are not read where there is a serial line: see VESC Tool"
        if self.limits is None:
            return f"{self.version}; its limits are not reported" if self.is_over else f"{self.version}, being asked"
        return (
            f"{self.version}; motor {self.limits.motor_min:g} to {self.limits.motor_max:g} A, "
            f"input {self.limits.input_min:g} to {self.limits.input_max:g} A"
        )
