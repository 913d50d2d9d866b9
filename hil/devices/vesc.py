# SPDX-License-Identifier: MIT
"""Two VESC controllers on one bus, one of them with its UART connected; packets between the two take no time."""

from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.drives.vesc.frames import (
    BROADCAST_ID,
    SET_PACKETS,
    Comm,
    PacketId,
    Ping,
    Pong,
    addressed,
    decode,
    frame_of,
)
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketReceiver, decode_short, frame_packet, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame, Link
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices._vesc_controller import TICK_NS, Controller, Firmware
from segway_ecc.hil.devices.device import supply_voltage

__all__ = ["TICK_NS", "SimulatedVesc"]

_SET_BY_PACKET: Final = {int(packet): command for command, packet in SET_PACKETS.items()}


class SimulatedVesc:
    """Both controllers; see `Device`.

    Attributes:
        left: The controller of the left wheel.
        right: The controller of the right wheel.
        bus_is_whole: Whether packets pass between the two; a test may break it.
        refused_frames: Frames and packets for them that they could not use.
    """

    inputs: Sequence[str] = ("left.torque", "right.torque")
    needs: Sequence[str] = ("left.angle", "left.velocity", "right.angle", "right.velocity")

    def __init__(
        self, link: Link, settings: VescSettings, port: Port | None = None, firmware: Firmware | None = None
    ) -> None:
        """Switch two controllers on, set up by `settings` where no `firmware` is given."""
        rate_hz = settings.status_rate_hz
        used = firmware or Firmware(timeout_s=settings.timeout_set_s, status={1: rate_hz, 5: rate_hz})
        self.left, self.right = Controller(settings.left, used), Controller(settings.right, used)
        self.bus_is_whole = True
        self.refused_frames = 0
        self._near, self._far = self.left, self.right
        if settings.serial_controller == "right":
            self._near, self._far = self.right, self.left
        self._link = link
        self._port = port
        self._receiver = PacketReceiver()

    def obey(self, frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Process commands from both lines and run the motors; see `Device.obey`."""
        self._measure(outputs)
        for frame in frames:
            self._receive(frame, now_ns)
        if self._port is not None:
            for packet in self._receiver.feed(self._port.read(self._port.in_waiting)):
                reply = self._process(self._near, packet, now_ns)
                if reply is not None:
                    self._port.write(frame_packet(reply))
        return self.left.run(now_ns), self.right.run(now_ns)

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send the status messages that are due."""
        self._measure(outputs)
        for controller in (self.left, self.right):
            for frame in controller.due(now_ns):
                self._link.send(frame)

    def _measure(self, outputs: Mapping[str, float]) -> None:
        for name, controller in (("left", self.left), ("right", self.right)):
            controller.measure(outputs[f"{name}.angle"], outputs[f"{name}.velocity"], supply_voltage(outputs))

    def _receive(self, frame: Frame, now_ns: int) -> None:
        address = addressed(frame)
        for controller in (self.left, self.right):
            if address is None or address[1] not in (controller.controller_id, BROADCAST_ID):
                continue
            try:
                self._obey(controller, address[0], frame.data, now_ns)
            except FrameRefusedError:
                self.refused_frames += 1

    def _obey(self, controller: Controller, command: PacketId, data: bytes, now_ns: int) -> None:
        if command is not PacketId.PROCESS_SHORT_BUFFER:
            payload = decode(command, data)
            controller.obey(command, payload, now_ns)
            if isinstance(payload, Ping):
                self._link.send(frame_of(PacketId.PONG, payload.sender_id, Pong(controller.controller_id, 0)))
            return
        short = decode_short(data)
        reply = None if short.mode is Mode.PASS_ON else self._process(controller, short.packet, now_ns)
        if reply is not None and short.mode is Mode.PROCESS:
            self._send(short.sender_id, controller, Mode.PASS_ON, reply)

    def _process(self, controller: Controller, packet: bytes, now_ns: int) -> bytes | None:
        """Obey a packet; returns the reply, where there is one."""
        try:
            if packet[0] in (Comm.GET_VALUES, Comm.GET_VALUES_SELECTIVE):
                return controller.reply(packet)
            if packet[0] in _SET_BY_PACKET:
                command = _SET_BY_PACKET[packet[0]]
                controller.obey(command, decode(command, packet[1:5]), now_ns)
            elif packet[0] == Comm.ALIVE:
                controller.stay_alive(now_ns)
            elif packet[0] == Comm.FORWARD_CAN and controller is self._near:
                return self._forward(packet[1:], now_ns)
        except FrameRefusedError:
            self.refused_frames += 1
        return None

    def _forward(self, packet: bytes, now_ns: int) -> bytes | None:
        """Hand a packet on over the bus, and its reply back."""
        if packet[:1] != bytes((self._far.controller_id,)) or not self.bus_is_whole:
            return None
        self._send(self._far.controller_id, self._near, Mode.PROCESS, packet[1:])
        reply = self._process(self._far, packet[1:], now_ns)
        if reply is not None:
            self._send(self._near.controller_id, self._far, Mode.PASS_ON, reply)
        return reply

    def _send(self, receiver_id: int, sender: Controller, mode: Mode, packet: bytes) -> None:
        for frame in frames_of(receiver_id, sender.controller_id, mode, packet):
            self._link.send(frame)
