# SPDX-License-Identifier: MIT
"""Simulated ODrives on a bus and a serial line in memory, ticked by hand, and the raw frames to send them."""

import struct
from collections.abc import Sequence
from functools import reduce
from operator import xor
from typing import Any

import msgspec

from segway_ecc.firmware_io.drives.odrive.messages import AxisState
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.odrive import Release, SimulatedOdrive
from tests.recording_link import RecordingLink

MS = 1_000_000
IDLE, CLOSED = AxisState.IDLE, AxisState.CLOSED_LOOP_CONTROL


class MemoryPort:
    """The board's end of a serial line."""

    def __init__(self) -> None:
        self.arrived = b""
        self.written = b""

    @property
    def in_waiting(self) -> int:
        return len(self.arrived)

    def read(self, size: int, /) -> bytes:
        data, self.arrived = self.arrived[:size], self.arrived[size:]
        return data

    def write(self, data: bytes, /) -> int:
        self.written += data
        return len(data)

    def close(self) -> None: ...


class Bench:
    """Two axes, a tick of 1 ms, and a plant by hand."""

    def __init__(self, firmware: str = "0.5", release: Release | None = None, **changes: Any) -> None:
        wheel = {"node_id": 0, "axis": 0, "max_torque": 4.0, "torque_constant": 0.5}
        right = {**wheel, "node_id": 1, "axis": 1, "direction": -1, "gear_ratio": 2.0}
        described = {"type": "odrive", "firmware": firmware, "axes": {"left": wheel, "right": right}, **changes}
        self.link, self.port = RecordingLink(), MemoryPort()
        settings = msgspec.convert(described, OdriveSettings)
        self.device = SimulatedOdrive(self.link, settings, self.port, release)
        self.left, self.right = self.device.axes
        self.now_ns = 0
        self.outputs = dict.fromkeys(self.device.needs, 0.0)
        self.torques: Sequence[float] = (0.0, 0.0)

    def tick(self, *frames: Frame, times: int = 1) -> list[Frame]:
        """Ticks, with frames in the first; what was sent in them."""
        self.link.frames.clear()
        for index in range(times):
            self.torques = self.device.obey(frames if index == 0 else (), self.now_ns, self.outputs)
            self.device.send_telemetry(self.now_ns, self.outputs)
            self.now_ns += MS
        return list(self.link.frames)

    def say(self, text: str, end: str = "\n") -> bytes:
        """A line with its checksum, and what was written back."""
        self.port.written = b""
        self.port.arrived = f"{text}*{reduce(xor, text.encode(), 0)}{end}".encode()
        self.tick()
        return self.port.written

    def close_loop(self) -> None:
        """Both axes to torque mode and closed loop."""
        for node in (0, 1):
            self.tick(mode(node, 1), torque(node, 0.0), clear(self.device.firmware, node), state(node, CLOSED))
        self.tick(torque(0, 0.0), torque(1, 0.0), times=5)
        assert (self.left.state, self.right.state) == (CLOSED, CLOSED)


def torque(node: int, value: float) -> Frame:
    return Frame(node << 5 | 0x0E, struct.pack("<fI", value, 0))


def state(node: int, value: int, length: int = 8) -> Frame:
    return Frame(node << 5 | 0x07, struct.pack("<II", value, 0)[:length])


def mode(node: int, control: int, how: int = 1) -> Frame:
    return Frame(node << 5 | 0x0B, struct.pack("<II", control, how))


def clear(firmware: str, node: int) -> Frame:
    return Frame(node << 5 | 0x18, b"" if firmware == "0.5" else b"\0")


def of(frames: Sequence[Frame], identifier: int) -> list[Frame]:
    return [frame for frame in frames if frame.arbitration_id == identifier]
