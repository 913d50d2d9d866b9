# SPDX-License-Identifier: MIT
"""What a simulated VESC is set to, and its answers to FW_VERSION and GET_MCCONF, packed as firmware 6.05 packs them.

Sources, in github.com/vedderb/bldc: comm/commands.c (`commands_process_packet`) for both packets, confgenerator.c and
confgenerator.h of commit 79c86db for the layout and the signature of the motor configuration; its fields are those that
CHANGELOG.md has for 6.05, such as the voltages of the soft regeneration limit. Another version has another layout.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from segway_ecc.firmware_io.drives.vesc.frames import Comm

VERSION: Final = (6, 5)
MCCONF_SIGNATURE: Final = 295_158_857
_HARDWARE: Final = b"60\0"
_NAME: Final = b"\0"
"""Of firmware that is the original one."""
_AFTER_UUID: Final = 8
"""Pairing, test version, kind of hardware, custom configurations, phase filter, two pages of QML, flags of the NRF."""
_LIMITS: Final = struct.Struct(">I4B4f2h3fh2f6hB4h3h2f3h")
_LATER_FIELDS: Final = 395
"""Bytes of the sensorless, hall, FOC, PID, motor and BMS fields after the limits, which are not simulated: zero."""
_FOC: Final = 2
_SHARE: Final = 10_000
_DECI: Final = 10


@dataclass(frozen=True, slots=True)
class Firmware:
    """What is set with VESC Tool; the defaults are those of a new controller.

    Attributes:
        timeout_s: Time without a command after which the motor is let go, s; 0 never.
        timeout_brake_current: Current that brakes it then, A.
        status: Which of the status messages 1 to 6 are sent, and how often, 1/s.
        max_current: Limit of the motor current that drives, A.
        min_current: Limit of the motor current that brakes, A; negative. None for as much as drives.
        max_erpm: Limit of the speed either way, electrical turns a minute.
        erpm_start: Share of it from which the current that drives is less.
        max_duty: Limit of the duty cycle.
        answers_configuration: Whether it answers GET_MCCONF.
        knows_flags: Whether the release is new enough to send its flags.
        version: What it answers to FW_VERSION.
    """

    timeout_s: float = 1.0
    timeout_brake_current: float = 0.0
    status: Mapping[int, float] = field(default_factory=dict)
    max_current: float = 60.0
    min_current: float | None = None
    max_erpm: float = 100_000.0
    erpm_start: float = 0.8
    max_duty: float = 0.95
    answers_configuration: bool = True
    knows_flags: bool = True
    version: tuple[int, int] = VERSION

    @property
    def braking_current(self) -> float:
        """Limit of the motor current that brakes, A; positive."""
        return self.max_current if self.min_current is None else -self.min_current


def version_reply(controller_id: int, version: tuple[int, int] = VERSION) -> bytes:
    """The answer to FW_VERSION; the serial number of the processor ends with the controller's number."""
    serial = controller_id.to_bytes(12, "big")
    return bytes((Comm.FW_VERSION, *version)) + _HARDWARE + serial + bytes(_AFTER_UUID) + _NAME


def configuration_reply(firmware: Firmware) -> bytes:
    """The answer to GET_MCCONF; those limits that are not simulated stand far away."""
    limits = (
        *(MCCONF_SIGNATURE, 0, 0, _FOC, 0),
        *(firmware.max_current, -firmware.braking_current, 99.0, -60.0),
        *(_SHARE, 50),  # input current: where its limit begins, and its filter
        *(150.0, -firmware.max_erpm, firmware.max_erpm, round(firmware.erpm_start * _SHARE)),
        *(300.0, 1500.0),  # full brake
        *(8 * _DECI, 57 * _DECI, 10 * _DECI, 8 * _DECI, 1_000 * _DECI, 1_100 * _DECI),  # supply
        1,
        *(85 * _DECI, 100 * _DECI, 85 * _DECI, 100 * _DECI),  # temperatures
        *(1_500, 50, round(firmware.max_duty * _SHARE)),
        *(1_500_000.0, -1_500_000.0),
        *(_SHARE, _SHARE, _SHARE),
    )
    return bytes((Comm.GET_MCCONF,)) + _LIMITS.pack(*limits) + bytes(_LATER_FIELDS)
