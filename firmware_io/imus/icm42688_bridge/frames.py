# SPDX-License-Identifier: MIT
"""The packets of bridge.ino, and what is in them in SI.

The sensor's sensitivities are those of its datasheet (TDK DS-000347) at full scales of 2000 deg/s and 16 g.
"""

import math
import struct
from collections import Counter
from typing import Final, NamedTuple

from segway_ecc.firmware_io.devices import FrameKey
from segway_ecc.firmware_io.imus.mounting import Vector
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, begins, crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import LOST

KEY: Final = FrameKey(0x1FFF_FF42, is_extended=True)
"""The frame that stands for a packet: one that no drive uses."""
COUNTS: Final = 1 << 16
STANDARD_GRAVITY: Final = 9.80665
RATE_STEP: Final = math.radians(2000.0) / 32768.0
"""rad/s."""
FORCE_STEP: Final = 16.0 * STANDARD_GRAVITY / 32768.0
"""m/s2."""
_DEGREES_PER_COUNT: Final = 1.0 / 132.48
_AT_ZERO_C: Final = 25.0
_BEGIN: Final = b"\xa5\x5a"
_VALUES: Final = struct.Struct("<H7h")
_CRC: Final = struct.Struct(">H")
_SIZE: Final = len(_BEGIN) + _VALUES.size + _CRC.size


class Measurement(NamedTuple):
    """One packet: number, angular velocity, rad/s, and specific force, m/s2, in the sensor's axes; degrees Celsius."""

    number: int
    rate: Vector
    force: Vector
    temperature: float


def read_measurement(data: bytes) -> Measurement:
    """What is in a frame.

    Raises:
        FrameRefusedError: It is of another length, or a value is at its end stop and may be any beyond it.
    """
    if len(data) != _VALUES.size:
        raise FrameRefusedError(Refusal.LENGTH, f"measurement of {len(data)} bytes")
    count, *raw, temperature = _VALUES.unpack(data)
    if any(value in (-32768, 32767) for value in raw):
        raise FrameRefusedError(Refusal.RANGE, f"measurement {data.hex()}")
    rate, force = (raw[0], raw[1], raw[2]), (raw[3], raw[4], raw[5])
    return Measurement(
        count,
        (rate[0] * RATE_STEP, rate[1] * RATE_STEP, rate[2] * RATE_STEP),
        (force[0] * FORCE_STEP, force[1] * FORCE_STEP, force[2] * FORCE_STEP),
        _AT_ZERO_C + temperature * _DEGREES_PER_COUNT,
    )


class BridgeCodec:
    """The protocol as a codec; see `SerialCodec`. The bridge sends unasked, and receives nothing."""

    def __init__(self) -> None:
        """Begin between two packets."""
        self.refused: Counter[str] = Counter()
        self._received = bytearray()
        self._count: int | None = None

    def encode(self, _frame: Frame) -> None:
        """Nothing is sent to the bridge."""

    def request(self) -> bytes:
        """Nothing: it is not asked."""
        return b""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """The frames of the packets that are whole now; see `SerialCodec.decode`."""
        received, frames = self._received, list[Frame]()
        received += data
        while begins(received, _BEGIN, self.refused) and len(received) >= _SIZE:
            values, crc = bytes(received[2 : 2 + _VALUES.size]), received[_SIZE - 2 : _SIZE]
            if crc16_xmodem(values) == _CRC.unpack(crc)[0]:
                self._note(values)
                frames.append(Frame(KEY.arbitration_id, values, now_ns, KEY.is_extended))
                del received[:_SIZE]
            else:
                self.refused[Refusal.CRC] += 1
                del received[:1]
        return frames

    def reset(self) -> None:
        """Discard what was received of an unfinished packet."""
        self._received.clear()
        self._count = None

    def _note(self, values: bytes) -> None:
        count: int = _VALUES.unpack(values)[0]
        if self._count is not None:
            self.refused[LOST] += max((count - self._count) % COUNTS - 1, 0)
        self._count = count
