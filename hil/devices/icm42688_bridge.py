# SPDX-License-Identifier: MIT
"""An ICM-42688-P behind its bridge, as bridge.ino behaves: it sends a packet each period, unasked, and obeys nobody."""

import math
import struct
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.imus.icm42688_bridge.settings import Icm42688BridgeSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices.family import SimulatedImu

_RATES: Final = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
_FORCES: Final = tuple(f"imu.linear_acceleration_{axis}" for axis in "xyz")
_LSB_PER_DEG_S: Final = 16.384
_LSB_PER_G: Final = 2048.0
_G: Final = 9.80665


class SimulatedIcm42688Bridge:
    """The bridge with its sensor; see `Device`. A sensor that is not `powered` leaves the bridge silent."""

    inputs: Sequence[str] = ()
    needs: Sequence[str] = (*_RATES, *_FORCES)
    refused_frames = 0

    def __init__(self, settings: Icm42688BridgeSettings, port: Port) -> None:
        """Switch it on."""
        self.powered = True
        self._port = port
        self._mounting = settings.rotation
        self._period_ns = round(settings.period_s * 1e9)
        self._due_ns: int | None = None
        self._counter = 0

    def obey(self, _frames: Sequence[Frame], _now_ns: int, _outputs: Mapping[str, float]) -> Sequence[float]:
        """Drive nothing, and read nothing; see `Device.obey`."""
        return ()

    def send_telemetry(self, now_ns: int, outputs: Mapping[str, float]) -> None:
        """Send a packet where one is due; see `Device.send_telemetry`. The means of bridge.ino are not simulated."""
        if self._due_ns is None:
            self._due_ns = now_ns
        if now_ns < self._due_ns:
            return
        self._due_ns += self._period_ns
        if not self.powered:
            return
        rates = self._mounting.to_sensor([outputs[name] for name in _RATES])
        forces = self._mounting.to_sensor([outputs[name] for name in _FORCES])
        raw = [math.degrees(rate) * _LSB_PER_DEG_S for rate in rates] + [force / _G * _LSB_PER_G for force in forces]
        values = [min(max(round(value), -32768), 32767) for value in raw]
        body = struct.pack("<H7h", self._counter, *values, 0)
        self._port.write(b"\xa5\x5a" + body + struct.pack(">H", _crc(body)))
        self._counter = (self._counter + 1) % 65536


def _crc(data: bytes) -> int:
    """Bit by bit, as bridge.ino has it."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def _device(settings: Icm42688BridgeSettings, _link: object, port: Port | None) -> SimulatedIcm42688Bridge:
    if port is None:
        raise ValueError("this IMU has a serial line of its own: simulate it at the end of one")
    return SimulatedIcm42688Bridge(settings, port)


SIMULATED: Final[SimulatedImu[Icm42688BridgeSettings]] = SimulatedImu(device=_device, frames=lambda _: ())
