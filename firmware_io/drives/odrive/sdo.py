# SPDX-License-Identifier: MIT
"""Settings on the wire: asked for over CAN from firmware 0.6, handed on by the serial line of 0.5.

RxSdo (0x04) asks for an endpoint by number, TxSdo (0x05) answers with the same number and the value. Source: ODrive's
DBC file of 0.6.10, and examples/can_param_access.py of github.com/odriverobotics/ODriveResources at 06dc846, which
reads a setting only where firmware and hardware are those that the list of numbers was made for. The serial codec of
0.5 hands on what it read in frames of the same layout, whose numbers are places in `OwnSetting`; a board of 0.5 has
no TxSdo of its own, and sends what bears its identifier there, Get_Sensorless_Error, only on request.
"""

import math
import struct
from typing import Final, Protocol

from segway_ecc.firmware_io.drives.odrive.frames import Firmware, arbitration_id
from segway_ecc.firmware_io.drives.odrive.messages import Version
from segway_ecc.firmware_io.drives.odrive.own_settings import OwnSettings
from segway_ecc.firmware_io.drives.odrive.setting_names import FLAGS, PATHS, OwnSetting
from segway_ecc.firmware_io.drives.odrive.settings import OdriveEndpoints, OdriveSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

RX_SDO: Final = 0x04
TX_SDO: Final = 0x05
_HEAD: Final = struct.Struct("<BHB")
_READ: Final = 0
_FLOAT: Final = struct.Struct("<f")
_FLAG: Final = struct.Struct("<?")
_SERIAL: Final = tuple(OwnSetting)
_ANSWERS_WITHIN_NS: Final = 50_000_000
_TRIES: Final = 3
_ROUND_EVERY_NS: Final = 2_000_000_000
"""Once all were read they are read again this often, since a person may be changing one."""
_LINE_ANSWERS_WITHIN_NS: Final = 5_000_000_000
"""A serial line that gives no settings for this long is one to fall back on and no more: a person looks them up."""


def read_request(node_id: int, endpoint: int) -> Frame:
    """The frame that asks a drive of 0.6 for an endpoint."""
    return Frame(arbitration_id(node_id, RX_SDO), _HEAD.pack(_READ, endpoint, 0))


def serial_answer(node_id: int, setting: OwnSetting, value: float) -> Frame:
    """The frame in which the serial line hands on a setting; NaN for one that the board does not have."""
    return Frame(arbitration_id(node_id, TX_SDO), _HEAD.pack(0, _SERIAL.index(setting), 0) + _FLOAT.pack(value))


def decode_answer(data: bytes) -> tuple[int, bytes]:
    """The endpoint that an answer is about, and the bytes of its value.

    Raises:
        FrameRefusedError: It has no value, or what is always zero is not.
    """
    if len(data) <= _HEAD.size:
        raise FrameRefusedError(Refusal.LENGTH, "TxSdo")
    first, endpoint, last = _HEAD.unpack_from(data)
    if first or last:
        raise FrameRefusedError(Refusal.UNKNOWN, "TxSdo")
    return endpoint, data[_HEAD.size :]


def _unpack(packing: struct.Struct, value: bytes) -> float:
    if len(value) < packing.size:
        raise FrameRefusedError(Refusal.LENGTH, "TxSdo")
    return float(packing.unpack_from(value)[0])


class SettingsReading(Protocol):
    """How the settings of one axis are read."""

    def next_request(self, now_ns: int) -> Frame | None:
        """What to send now; None where nothing is to be asked, or an answer is waited for."""

    def take(self, data: bytes) -> None:
        """Take an answer; FrameRefusedError where it is none that was waited for."""

    def waits(self, now_ns: int) -> bool:
        """Whether arming is to wait for what is still to be read."""

    def note_version(self, version: Version) -> None:
        """The drive answered what it is."""

    def reset(self) -> None:
        """Begin anew: the drive may have been restarted."""

    def arming_failures(self) -> list[str]:
        """Why settings cannot be read, each with its remedy."""


class SerialReading:
    """Takes the settings that the serial line of 0.5 reads by itself; see `SettingsReading`."""

    def __init__(self, own: OwnSettings) -> None:
        """Fill `own`."""
        self._own = own
        self._since_ns: int | None = None

    def next_request(self, now_ns: int) -> Frame | None:
        """Nothing is asked over the bus; see `SettingsReading`."""
        self._since_ns = now_ns if self._since_ns is None else self._since_ns
        return None

    def take(self, data: bytes) -> None:
        """Take one; see `SettingsReading`."""
        number, value = decode_answer(data)
        if number >= len(_SERIAL):
            raise FrameRefusedError(Refusal.UNKNOWN, "TxSdo")
        self._own.take(_SERIAL[number], _unpack(_FLOAT, value))

    def waits(self, now_ns: int) -> bool:
        """Until all are known, or the line was silent for long; see `SettingsReading`."""
        if self._own.knows(_SERIAL):
            return False
        return self._since_ns is None or now_ns - self._since_ns < _LINE_ANSWERS_WITHIN_NS

    def note_version(self, version: Version) -> None:
        """A board of 0.5 answers none; see `SettingsReading`."""

    def reset(self) -> None:
        """Forget them; see `SettingsReading`."""
        self._own.reset()
        self._since_ns = None

    def arming_failures(self) -> list[str]:
        """A line that does not answer is known by its own means; see `SettingsReading`."""
        return []


class SdoReading:
    """Asks a drive of 0.6 for its settings; see `SettingsReading`."""

    def __init__(self, node_id: int, endpoints: OdriveEndpoints, own: OwnSettings) -> None:
        """Fill `own` with those whose endpoints are named."""
        paths = {path.format(0): setting for setting, path in PATHS[Firmware.V0_6].items()}
        self._node_id = node_id
        self._endpoints = endpoints
        self._own = own
        self._order = tuple((paths[path], number) for path, number in endpoints.ids.items())
        self._version: Version | None = None
        self._place = self._tries = 0
        self._next_ns = self._now_ns = 0

    def next_request(self, now_ns: int) -> Frame | None:
        """One setting after the other, three times at the most each; see `SettingsReading`."""
        if self._mismatch is not None or now_ns < self._next_ns:
            return None
        if self._tries >= _TRIES:
            self._own.take(self._order[self._place][0], math.nan)
            self._advance(now_ns)
            return None
        self._tries += 1
        self._next_ns = now_ns + _ANSWERS_WITHIN_NS
        self._now_ns = now_ns
        return read_request(self._node_id, self._order[self._place][1])

    def take(self, data: bytes) -> None:
        """Take the answer to the question that is open; see `SettingsReading`."""
        number, value = decode_answer(data)
        setting, asked = self._order[self._place]
        if not self._tries or number != asked:
            raise FrameRefusedError(Refusal.UNKNOWN, "TxSdo")
        self._own.take(setting, _unpack(_FLAG if setting in FLAGS else _FLOAT, value))
        self._advance(self._now_ns)

    def waits(self, now_ns: int) -> bool:
        """Until each was answered, or asked for in vain; see `SettingsReading`."""
        del now_ns
        return self._version is None or (
            self._mismatch is None and not self._own.knows([setting for setting, _ in self._order])
        )

    def note_version(self, version: Version) -> None:
        """Compare it with the one that the endpoints are of; see `SettingsReading`."""
        self._version = version

    def reset(self) -> None:
        """Begin anew; see `SettingsReading`."""
        self._own.reset()
        self._version = None
        self._place = self._tries = 0
        self._next_ns = self._now_ns = 0

    def arming_failures(self) -> list[str]:
        """Endpoints of another release or hardware, or without an answer; see `SettingsReading`."""
        endpoints = self._endpoints
        if self._version is not None and self._mismatch is not None:
            failure = (
                f"{self._mismatch}, the endpoints in the robot file are of {endpoints.firmware} on hardware "
                f"{endpoints.hardware}; copy them from the flat_endpoints.json of what it is"
            )
            return [failure]
        return [
            f"does not answer for {path} at endpoint {number}; see flat_endpoints.json of {endpoints.firmware} on "
            f"hardware {endpoints.hardware}"
            for (setting, _), (path, number) in zip(self._order, endpoints.ids.items(), strict=True)
            if setting in self._own.unread
        ]

    @property
    def _mismatch(self) -> str | None:
        """What the drive is where that is not what the endpoints are of, or not known; None where it is."""
        version = self._version
        if version is None:
            return "it has not answered its version"
        firmware = f"{version.firmware_major}.{version.firmware_minor}.{version.firmware_revision}"
        hardware = f"{version.hardware_major}.{version.hardware_minor}.{version.hardware_variant}"
        if (firmware, hardware) == (self._endpoints.firmware, self._endpoints.hardware):
            return None
        return f"is firmware {firmware} on hardware {hardware}"

    def _advance(self, now_ns: int) -> None:
        """Go on to the next; after the last one, wait."""
        self._place = (self._place + 1) % len(self._order)
        self._tries = 0
        self._next_ns = now_ns + (0 if self._place else _ROUND_EVERY_NS)


def settings_reading(name: str, settings: OdriveSettings, own: OwnSettings) -> SettingsReading | None:
    """How the settings of the axis of a wheel are read; None where no line allows that."""
    if settings.endpoints is not None:
        return SdoReading(settings.axes[name].node_id, settings.endpoints, own)
    return None if settings.serial is None else SerialReading(own)
