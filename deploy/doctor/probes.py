# SPDX-License-Identifier: MIT
"""What has to be tried on the real machine."""

import math
import os
import socket
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

from segway_ecc.deploy.doctor.system import WriteSpeed
from segway_ecc.firmware_io.build import sleep_until_ns
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState, read_interface_state
from segway_ecc.firmware_io.links.serial_port import open_serial_port
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.cycle.timing import Histogram, Summary

_MEASURED_NS: Final = 2_000_000_000
_PROGRESS_EVERY_NS: Final = 200_000_000
_PIECES: Final = 8
_PIECE_BYTES: Final = 512 * 1024


class RealProbes:
    """Tries on this machine what `Probes` names."""

    def __init__(self, on_progress: Callable[[float], None] = lambda _: None, measured_ns: int = _MEASURED_NS) -> None:
        """Pass `on_progress` how much of the measurement is done, 0 to 1; it takes `measured_ns`."""
        self._on_progress = on_progress
        self._measured_ns = measured_ns

    def can_socket(self) -> None:
        """Make a raw CAN socket and close it."""
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()

    def interface(self, name: str) -> InterfaceState:
        """Ask the kernel."""
        return read_interface_state(name)

    def open_port(self, settings: SerialSettings) -> None:
        """Open the port as the robot does, and close it."""
        open_serial_port(settings).close()

    def wake_ups(self, period_ns: int) -> Summary:
        """Wait for deadlines as the robot's loop does, with the priority that it would get here."""
        lateness = Histogram()
        cycles = math.ceil(self._measured_ns / period_ns)
        progress_every = max(_PROGRESS_EVERY_NS // period_ns, 1)
        with real_time_priority():
            deadline_ns = time.monotonic_ns()
            for cycle in range(1, cycles + 1):
                # Deadlines that have passed are skipped, as in the robot's loop: one delay is counted once.
                deadline_ns += period_ns * max(1, math.ceil((time.monotonic_ns() - deadline_ns) / period_ns))
                sleep_until_ns(deadline_ns)
                lateness.add(time.monotonic_ns() - deadline_ns)
                if cycle % progress_every == 0:
                    self._on_progress(cycle / cycles)
        return lateness.summary()

    def write(self, folder: Path) -> WriteSpeed:
        """Write a few pieces and wait for each; nothing of it stays."""
        piece, slowest_ns, all_ns = os.urandom(_PIECE_BYTES), 0, 0
        with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
            for _ in range(_PIECES):
                start_ns = time.monotonic_ns()
                file.write(piece)
                os.fsync(file.fileno())
                taken_ns = time.monotonic_ns() - start_ns
                slowest_ns, all_ns = max(slowest_ns, taken_ns), all_ns + taken_ns
        return WriteSpeed(_PIECES * _PIECE_BYTES / max(all_ns * 1e-9, 1e-9), slowest_ns * 1e-9)
