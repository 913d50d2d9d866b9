# SPDX-License-Identifier: MIT
"""The board of a hoverboard as its firmware behaves, at the device's end of a serial line.

Written from EFeru/hoverboard-firmware-hack-FOC: Src/main.c at efb438b, Src/util.c at 29535a2, Inc/config.h at 00a6283,
BLDC_controller_data.c at 39e4fdc; counts from its forks with odometry. Currents follow their commands at once.
"""

import math
import struct
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from segway_ecc.firmware_io.drives.hoverboard.settings import HoverboardSettings, HoverboardWheelSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.firmware_io.links.serial_link import Port
from segway_ecc.hil.devices.device import supply_voltage
from segway_ecc.hil.devices.family import SimulatedDrives

TICK_NS: Final = 1_000_000
_LOOP_NS: Final = 5_062_500  # `buzzerTimer - buzzerTimer_prev > 16 * DELAY_IN_MAIN_LOOP`, in ticks of 1/16 ms
_BEEPS_NS: Final = 300_000_000  # both beeps at switching the motors on hold up the main loop
_COUNTS_PER_NS: Final = 16e-6
_MOST_COUNTS: Final = 2000  # z_maxCntRst: so long after a Hall edge the speed is 0
_SPEED_COEFFICIENT, _TRANSIENT_COUNTS, _AVERAGED = 10667, 40, 4
_EDGES, _COUNTS, _SMALL, _DRIVING_RPM, _BUFFER_BYTES = 90, 9000, 50, 20, 64
_DEAD_V: Final = 33.7  # BAT_DEAD: 3.37 V for each of ten cells


@dataclass(frozen=True, slots=True)
class Build:
    """What is compiled in: names of config.h, with what docs/drives/hoverboard.md asks for."""

    i_mot_max: float
    serial_timeout: int
    odometry: bool
    n_mot_max: int = 2000
    rate: int = 32767
    filter: int = 65535
    inactivity_timeout_min: int = 100


class _Motor:
    """A motor with its Hall sensors, in its own sense: the right one stands mirrored.

    The speed is made of the time between edges, in whole counts of 16 kHz: of four edges, or of the last where they
    change by more than dz_cntTrnsDet.
    """

    def __init__(self, settings: HoverboardWheelSettings, sense: int) -> None:
        self.current = 0.0
        self.ticks = self.n_mot = 0
        self._settings, self._sense = settings, sense
        self._edges: deque[int] = deque(maxlen=_AVERAGED + 1)

    def measure(self, angle: float, velocity: float, now_ns: int) -> None:
        turned, speed = (self._sense * self._settings.motor(each) * _EDGES / math.tau for each in (angle, velocity))
        now, sense = now_ns * _COUNTS_PER_NS, 1 if speed > 0.0 else -1
        if (self.n_mot or sense) * sense < 0 or (self._edges and now - self._edges[-1] > _MOST_COUNTS):
            self._edges.clear()
            self.n_mot = 0
        while self.ticks != math.floor(turned + 0.5):
            step = 1 if turned + 0.5 > self.ticks else -1
            self.ticks += step
            ago_ns = 1e9 * (turned + 0.5 - self.ticks - (step < 0)) / speed if speed else 0.0
            self._edges.append(math.floor(now - max(ago_ns, 0.0) * _COUNTS_PER_NS))
            times = [late - early for early, late in pairwise(self._edges)]
            if times:
                is_steady = len(times) == _AVERAGED and abs(times[-1] - times[-2]) <= _TRANSIENT_COUNTS
                counted = sum(times) / _AVERAGED if is_steady else times[-1]
                self.n_mot = sense * int(_SPEED_COEFFICIENT * 16 / max(counted, 1.0)) >> 4

    def torque(self, n_mot_max: int) -> float:
        is_too_fast = abs(self.n_mot) >= n_mot_max and self.n_mot * self.current > 0.0
        current = 0.0 if is_too_fast else self._sense * self.current
        return self._settings.wheel_torque(current * self._settings.torque_constant)


class _Input:
    """The way of one command through rate limiter and low-pass filter, in the firmware's fixed point."""

    def __init__(self) -> None:
        self.limited = self.filtered = 0

    def follow(self, command: int, build: Build) -> int:
        self.limited += min(max((command << 4) - self.limited, -build.rate), build.rate)
        self.filtered += (((self.limited >> 4 << 4) - (self.filtered >> 12)) * build.filter) >> 4
        return self.filtered >> 16


class SimulatedHoverboard:
    """The board; see `Device`. While it `has_error` its motors are off, and nothing that it sends shows that."""

    inputs: Sequence[str] = ("left.torque", "right.torque")
    needs: Sequence[str] = ("left.angle", "left.velocity", "right.angle", "right.velocity")

    def __init__(self, settings: HoverboardSettings, port: Port | None) -> None:
        """Switch it on, built as `settings` have it."""
        if port is None:
            raise ValueError("a hoverboard has a serial line only: simulate it at the end of one")
        self.build = Build(settings.max_current, settings.serial_timeout_cycles, settings.feedback == "odometry")
        self.has_error, self.enable, self.is_powered = False, False, True
        self._port, self._inputs, self._command = port, (_Input(), _Input()), (0, 0)
        self._left, self._right = _Motor(settings.left, 1), _Motor(settings.right, -1)
        self._block, self._feedback, self._voltage = bytearray(), b"", 0.0
        self.refused_frames = self._silent_loops = self._loops = self._inactive_loops = self._next_ns = 0
        self._ticked_ns = 0

    def obey(self, _frames: Sequence[Frame], now_ns: int, outputs: Mapping[str, float]) -> Sequence[float]:
        """Take what has arrived on the line, and run the loops that are due; see `Device.obey`."""
        self._voltage = supply_voltage(outputs)
        for name, motor in (("left", self._left), ("right", self._right)):
            motor.measure(outputs[f"{name}.angle"], outputs[f"{name}.velocity"], now_ns)
        data, elapsed_ns, self._ticked_ns = self._port.read(self._port.in_waiting), now_ns - self._ticked_ns, now_ns
        if elapsed_ns > 2 * TICK_NS:  # in real time, a tick that came late has not seen the pauses between packets
            for at in range(0, len(data), 8):
                self._take(data[at : at + 8])
        elif data:
            self._block = (self._block + data)[: _BUFFER_BYTES + 1]
        elif self._block:  # the interrupt of an idle line: a block of any other length is not even looked at
            self._take(bytes(self._block))
            self._block.clear()
        while self.is_powered and self._next_ns <= now_ns:
            self._next_ns = max(self._next_ns, now_ns - _LOOP_NS) + _LOOP_NS + self._run_loop()
        is_on = self.is_powered and self.enable and not self.has_error
        return [motor.torque(self.build.n_mot_max) if is_on else 0.0 for motor in (self._left, self._right)]

    def send_telemetry(self, _now_ns: int, _outputs: Mapping[str, float]) -> None:
        """Send the feedback of the last loop."""
        self._port.write(self._feedback)
        self._feedback = b""

    def _take(self, block: bytes) -> None:
        start, steer, speed, checksum = struct.unpack("<HhhH", block) if len(block) == 8 else (0, 0, 0, 0)  # noqa: PLR2004
        if start != 0xABCD or checksum != start ^ (steer % 65536) ^ (speed % 65536):  # noqa: PLR2004
            self.refused_frames += 1
            return
        self._command, self._silent_loops = (steer, speed), 0

    def _run_loop(self) -> int:
        """One pass of the main loop of main.c; what it is held up for, ns."""
        has_timed_out = self._silent_loops >= self.build.serial_timeout
        self._silent_loops += not has_timed_out
        commands = (0, 0) if has_timed_out else tuple(min(max(raw, -1000), 1000) for raw in self._command)
        self.enable = self.enable and not self.has_error
        if not self.enable and not self.has_error and max(map(abs, commands)) < _SMALL:
            self._inputs[0].filtered = self._inputs[1].filtered = 0
            self.enable = True
            return _BEEPS_NS
        left, right = (each.follow(command, self.build) for each, command in zip(self._inputs, commands, strict=True))
        scale = 0.0 if has_timed_out else self.build.i_mot_max / 1000.0  # timed out: OPEN_MODE
        self._left.current, self._right.current = left * scale, -right * scale
        self._feedback = self._packet(*commands) if self._loops % 2 == 0 else self._feedback
        self._loops += 1
        self._inactive_loops = 0 if max(abs(left), abs(right)) > _SMALL else self._inactive_loops + 1
        is_dead = self._voltage < _DEAD_V and abs(self._left.n_mot - self._right.n_mot) // 2 < _DRIVING_RPM
        if is_dead or self._inactive_loops > self.build.inactivity_timeout_min * 60_000 // 6:
            self.is_powered = False
        return 0

    def _packet(self, steer: int, speed: int) -> bytes:
        """The feedback."""
        words = [0xABCD, steer, speed, self._right.n_mot, self._left.n_mot]
        if self.build.odometry:
            words += [-self._right.ticks % _COUNTS, self._left.ticks % _COUNTS]
        words += [round(self._voltage * 100.0), 350, 0]
        packet, checksum = b"", 0
        for word in words:
            packet += struct.pack("<H", word % 65536)
            checksum ^= word % 65536
        return packet + struct.pack("<H", checksum)


def _fail(board: SimulatedHoverboard) -> None:
    board.has_error = True


SIMULATED: Final[SimulatedDrives[HoverboardSettings, SimulatedHoverboard]] = SimulatedDrives(
    tick_ns=TICK_NS, device=lambda settings, _link, port: SimulatedHoverboard(settings, port), fail=_fail
)
