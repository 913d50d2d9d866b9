# SPDX-License-Identifier: MIT
"""What a check looks at, a machine and the work it is to do, and what it finds."""

import enum
import errno
import math
import os
import platform
import socket
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.deploy.support.commands import answer_of
from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState, read_interface_state
from segway_ecc.firmware_io.links.serial_link import open_serial_port
from segway_ecc.firmware_io.links.settings import CanSettings, PortSettings
from segway_ecc.firmware_io.settings import HardwareSettings
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.cycle.real_time import real_time_priority
from segway_ecc.node.cycle.timing import Histogram, Summary
from segway_ecc.node.watchdog.exits import ask_before_exit

_MEASURED_NS: Final = 2_000_000_000
_PROGRESS_EVERY_NS: Final = 200_000_000
_PIECES: Final = 8
_PIECE_BYTES: Final = 512 * 1024
_ASKS: Final = 255
"""The status of a process of which the kernel asks: no error's number, and with 0 it would wait for an answer."""
_PATIENCE_S: Final = 60.0
"""For a program's answer: a small computer that is busy takes half a minute to load ROS."""
UNNAMED_PERIOD_NS: Final = 5_000_000
"""Of a robot that is not named: 200 Hz."""


class Verdict(enum.StrEnum):
    """Whether what was found fits a robot."""

    GOOD = "good"
    WARNING = "warning"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """What was looked at, what is there, and whether that fits; where it is good, effect and remedy may be empty.

    The effect is what it does to the robot, the remedy the command or the file that changes it.
    """

    name: str
    verdict: Verdict
    found: str
    effect: str = ""
    remedy: str = ""

    def __post_init__(self) -> None:
        """Refuse a defect without its effect or its remedy; ValueError."""
        if self.verdict is not Verdict.GOOD and not (self.effect and self.remedy):
            raise ValueError(f"finding '{self.name}' is {self.verdict} and lacks its effect or remedy")


def good(name: str, found: str) -> Finding:
    """What is as it should be, or stands only for information."""
    return Finding(name, Verdict.GOOD, found)


def warning(name: str, found: str, effect: str, remedy: str) -> Finding:
    """What the robot runs with, but less well."""
    return Finding(name, Verdict.WARNING, found, effect, remedy)


def bad(name: str, found: str, effect: str, remedy: str) -> Finding:
    """What the robot must not run with."""
    return Finding(name, Verdict.BAD, found, effect, remedy)


def graded(name: str, found: str, effect: str, remedy: str, *, fits: bool) -> Finding:
    """Good where it fits, else a warning."""
    return warning(name, found, effect, remedy) if not fits else good(name, found)


def is_fit(findings: Iterable[Finding]) -> bool:
    """Whether nothing is bad."""
    return all(finding.verdict is not Verdict.BAD for finding in findings)


class WriteSpeed(NamedTuple):
    """How fast a folder takes what is written and waited for: bytes/s, and the slowest wait, s."""

    bytes_per_s: float
    slowest_s: float


_answer_of_busy_machine: Final = partial(answer_of, patience_s=_PATIENCE_S)


class Probes:
    """What no file shows, and has to be tried; what fails raises OSError."""

    def __init__(self, on_progress: Callable[[float], None] = lambda _: None, measured_ns: int = _MEASURED_NS) -> None:
        """Pass `on_progress` how much of the measurement is done, 0 to 1; it takes `measured_ns`."""
        self._on_progress = on_progress
        self._measured_ns = measured_ns

    def can_socket(self) -> None:
        """Make a raw CAN socket and close it."""
        socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW).close()

    def ask_before_exit(self) -> None:
        """Have the kernel ask before a process ends, one that ends at once."""
        pid = os.fork()
        if pid == 0:
            status = errno.EIO
            try:
                ask_before_exit()
                status = _ASKS
            except OSError as error:
                status = error.errno or status
            finally:
                os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        if status != _ASKS:
            raise OSError(status, os.strerror(status))

    def interface(self, name: str) -> InterfaceState:
        """Ask the kernel."""
        return read_interface_state(name)

    def open_port(self, settings: PortSettings) -> None:
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
                RealClock().sleep_until_ns(deadline_ns)
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


@dataclass(frozen=True, slots=True)
class System:
    """What the checks may look at.

    Attributes:
        probes: What has to be tried.
        root: Where /proc, /sys, /dev, /run and /etc are.
        answer: What a program prints, or NoAnswerError.
        environment: Environment variables.
        python: Which Python runs this.
        is_debug_python: Whether it is a debug build.
        processor: The machine's processor, as uname has it.
    """

    probes: Probes
    root: Path = Path("/")
    answer: Callable[[Sequence[str]], str] = _answer_of_busy_machine
    environment: Mapping[str, str] = field(default_factory=lambda: os.environ)
    python: str = f"{platform.python_implementation()} {platform.python_version()}"
    is_debug_python: bool = hasattr(sys, "gettotalrefcount")
    processor: str = platform.machine()

    def path(self, path: str | Path) -> Path:
        """Where an absolute path of the machine is."""
        return self.root / str(path).lstrip("/")

    def read(self, path: str) -> str | None:
        """The text of a file of the machine without its last line end; None where it cannot be read."""
        try:
            return self.path(path).read_text("utf-8", "replace").rstrip("\n\0")
        except OSError:
            return None

    def read_all(self, pattern: str) -> dict[str, str]:
        """The texts of all files that fit a pattern, by path."""
        paths = (f"/{found.relative_to(self.root)}" for found in sorted(self.root.glob(pattern.lstrip("/"))))
        return {path: text for path in paths if (text := self.read(path)) is not None}


@dataclass(frozen=True, slots=True)
class Workload:
    """What the machine is to do.

    Attributes:
        logs: Where logs go; a folder that may have to be made.
        log_bytes: What they may take, together.
        robot: The robot file; None where no robot is named.
        period_ns: The period of its loop.
    """

    logs: Path
    log_bytes: int
    robot: RobotFile | None = None
    period_ns: int = UNNAMED_PERIOD_NS

    @property
    def hardware(self) -> HardwareSettings | None:
        """The drives; None where the robot is all model, or none is named."""
        hardware = None if self.robot is None else self.robot.hardware
        return None if isinstance(hardware, NoHardwareSection) else hardware

    @property
    def needs_socketcan(self) -> bool:
        """Whether the robot's drives are on a CAN interface of the kernel; `auto` means one, too."""
        line = None if self.hardware is None else self.hardware.line
        return isinstance(line, CanSettings) and line.interface in {"auto", "socketcan"}
