# SPDX-License-Identifier: MIT
"""What passes on the line of a hoverboard: the bytes, the frames in their place, and both in SI.

Source: EFeru/hoverboard-firmware-hack-FOC, Src/main.c at efb438b (feedback, outputs), Src/util.c at 29535a2 (commands).
Little-endian words of 16 bits, begun by 0xABCD and ended by the exclusive or of all before.
"""

import functools
import operator
import struct
from collections import Counter
from typing import Final, NamedTuple

from segway_ecc.firmware_io.devices import TURN
from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, begins
from segway_ecc.firmware_io.links.link import Frame

COMMAND, FEEDBACK = 0x10, 0x11  # the frames in place of both kinds of packets: all between start and checksum
FULL: Final = 1000  # the largest command, either way
TICKS_PER_TURN: Final = 90  # 15 pole pairs, six Hall states each
TICK_COUNTS: Final = 9000  # where they begin anew (odom_l, odom_r of the firmwares with odometry)
_FASTEST_RPM: Final = 2047  # the firmware's speeds have 16 bits, four of them after the point
_BEGIN: Final = b"\xcd\xab"
_COMMAND: Final = struct.Struct("<hh")
_FEEDBACK: Final = {14: struct.Struct("<hhhhhhH"), 18: struct.Struct("<hhhhhhhhH")}  # without and with odometry
_AROUND_BYTES: Final = 4


class Feedback(NamedTuple):
    """What the board reports, of the left motor first: commands as it took them; velocities, rad/s, and counts of the
    Hall sensors (none without odometry), positive and rising where a positive command turns it; V, degrees Celsius.
    """  # noqa: D205 - one sentence

    commands: tuple[int, int]
    velocities: tuple[float, float]
    ticks: tuple[int, ...]
    voltage: float
    temperature: float


def command_frame(left: int, right: int) -> Frame:
    """The frame that commands both motors, -1000 to 1000 of the largest current; with TANK_STEERING left is `steer`."""
    return Frame(COMMAND, _COMMAND.pack(left, right))


def read_feedback(data: bytes) -> Feedback:
    """What is in a frame of feedback; FrameRefusedError where that cannot be.

    The motors stand mirrored: the right one reports a robot that rolls forward as negative.
    """
    layout = _FEEDBACK.get(len(data))
    if layout is None:
        raise FrameRefusedError(Refusal.LENGTH, f"feedback of {len(data)} bytes")
    steer, speed, right, left, *ticks, voltage, temperature, _ = layout.unpack(data)
    is_possible = max(abs(steer), abs(speed)) <= FULL and max(abs(right), abs(left)) <= _FASTEST_RPM
    if not (is_possible and all(0 <= count < TICK_COUNTS for count in ticks)):
        raise FrameRefusedError(Refusal.RANGE, f"feedback {data.hex()}")
    velocities = (_velocity(left), -_velocity(right))
    return Feedback((steer, speed), velocities, tuple(reversed(ticks)), voltage * 0.01, temperature * 0.1)


def _velocity(rpm: int) -> float:
    """rad/s of whole turns a minute, which the firmware rounds down (BLDC_controller.c, n_mot): the middle is meant."""
    return (rpm + 0.5) * TURN / 60.0 if rpm else 0.0


def _checksum(packet: bytes) -> int:
    """The exclusive or of all words; 0 of a packet that ends in its own."""
    return functools.reduce(operator.xor, memoryview(packet).cast("H"))


class HoverboardCodec:
    """The protocol as a codec; see `SerialCodec`. The board sends its feedback unasked, every 10.1 ms."""

    def __init__(self, settings: HoverboardSettings) -> None:
        """Speak with the firmware that the settings name."""
        self.refused: Counter[str] = Counter()
        self._size = _AROUND_BYTES + (18 if settings.feedback == "odometry" else 14)
        self._received = bytearray()

    def encode(self, frame: Frame) -> bytes | None:
        """The packet of a command; see `SerialCodec.encode`."""
        packet = _BEGIN + frame.data
        return packet + struct.pack("<H", _checksum(packet)) if frame.arbitration_id == COMMAND else None

    def request(self) -> bytes:
        """Nothing: the board is not asked."""
        return b""

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """The frames of the packets that are whole now; see `SerialCodec.decode`."""
        received, size, frames = self._received, self._size, list[Frame]()
        received += data
        while begins(received, _BEGIN, self.refused) and len(received) >= size:
            packet = bytes(received[:size])
            if _checksum(packet):
                self.refused["checksum"] += 1
                del received[:1]
            else:
                frames.append(Frame(FEEDBACK, packet[2:-2], now_ns))
                del received[:size]
        return frames

    def reset(self) -> None:
        """Discard what was received of an unfinished packet."""
        self._received.clear()
