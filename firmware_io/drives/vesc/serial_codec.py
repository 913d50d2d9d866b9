# SPDX-License-Identifier: MIT
"""The UART of one VESC as a line that carries the frames of all.

Commands for the controller at the UART go to it; those for the others are handed on by it over CAN. So the line
helps where this computer has lost the bus, not where the bus between the controllers is broken.
"""

from collections import Counter
from typing import Final

from msgspec.structs import replace

from segway_ecc.firmware_io.drives.vesc.frames import (
    SET_PACKETS,
    PacketId,
    Status,
    Status5,
    addressed,
    ask_selective,
    decode_values,
    encode_values,
    forward,
    frame_of,
    mask_of,
)
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketReceiver, frame_packet, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame

_NEEDED: Final = ("motor_current", "duty", "erpm", "bus_voltage", "tachometer", "fault", "controller_id")
_MASK: Final = mask_of((*_NEEDED, "flags"))
_SET_BYTES: Final = 4


class VescSerialCodec:
    """Translates between the frames of several controllers and the serial protocol of one; see `SerialCodec`.

    `refused` is what was received and not taken, by cause; garbage counts in bytes.
    """

    def __init__(self, settings: VescSettings) -> None:
        """Speak to the controllers of a robot through the UART of one of them."""
        self._hosts = {settings.axes[name].controller_id: host_id for name, host_id in settings.host_ids.items()}
        near = settings.serial_controller
        self._near = next(iter(self._hosts)) if near is None else settings.axes[near].controller_id
        self._far = [controller_id for controller_id in self._hosts if controller_id != self._near]
        self._receiver = PacketReceiver()
        self.refused: Counter[str] = self._receiver.refused

    def encode(self, frame: Frame) -> bytes | None:
        """The packet that carries what a frame does; a question is answered by all of the telemetry."""
        address = addressed(frame)
        if address is None or address[1] not in self._hosts:
            return None
        command, controller_id = address
        if command is PacketId.PROCESS_SHORT_BUFFER:
            return self._ask(controller_id)
        if command not in SET_PACKETS or len(frame.data) != _SET_BYTES:
            return None
        return self._framed(controller_id, bytes((SET_PACKETS[command],)) + frame.data)

    def request(self) -> bytes:
        """The packets that ask all controllers for their telemetry."""
        return b"".join(map(self._ask, (self._near, *self._far)))

    def decode(self, data: bytes, now_ns: int) -> list[Frame]:
        """Take received bytes; see `SerialCodec.decode`."""
        frames: list[Frame] = []
        for packet in self._receiver.feed(data):
            try:
                frames += self._frames(packet)
            except FrameRefusedError as error:
                self.refused[error.refusal] += 1
        return [replace(frame, received_ns=now_ns) for frame in frames]

    def reset(self) -> None:
        """Discard what was received of an unfinished packet."""
        self._receiver.reset()

    def _framed(self, controller_id: int, packet: bytes) -> bytes:
        return frame_packet(packet if controller_id == self._near else forward(controller_id, packet))

    def _ask(self, controller_id: int) -> bytes:
        return self._framed(controller_id, ask_selective(_MASK))

    def _frames(self, packet: bytes) -> list[Frame]:
        """The frames that carry the contents of a reply."""
        mask, values = decode_values(packet)
        if mask != _MASK or not values.keys() >= set(_NEEDED) or values["controller_id"] not in self._hosts:
            raise FrameRefusedError(Refusal.UNKNOWN, f"reply to 0x{mask:08X}")
        controller_id = int(values["controller_id"])
        status = Status(values["erpm"], values["motor_current"], values["duty"])
        status_5 = Status5(int(values["tachometer"]), values["bus_voltage"])
        frames = [
            frame_of(PacketId.STATUS, controller_id, status),
            frame_of(PacketId.STATUS_5, controller_id, status_5),
        ]
        for name in ("fault", "flags"):
            if name in values:
                answer = encode_values(ask_selective(mask_of((name,))), values)
                frames += frames_of(self._hosts[controller_id], controller_id, Mode.PASS_ON, answer)
        return frames
