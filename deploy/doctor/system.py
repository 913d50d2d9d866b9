# SPDX-License-Identifier: MIT
"""The machine as the checks see it, and what is to run on it."""

import os
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from segway_ecc.deploy.support.parts.commands import NoAnswerError, answer_of
from segway_ecc.firmware_io.build import HardwareSettings
from segway_ecc.firmware_io.links.can_interfaces import InterfaceState
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.node.config import NoHardwareSection, RobotFile
from segway_ecc.node.cycle.timing import Summary

__all__ = ["NoAnswerError", "Probes", "System", "Workload", "WriteSpeed"]

_PATIENCE_S: Final = 60.0
"""For a program's answer: a small computer that is busy takes half a minute to load ROS."""
UNNAMED_PERIOD_NS: Final = 5_000_000
"""Of a robot that is not named: 200 Hz."""


class WriteSpeed(NamedTuple):
    """How fast a folder takes what is written and waited for: bytes/s, and the slowest wait, s."""

    bytes_per_s: float
    slowest_s: float


_answer_of_busy_machine: Final = partial(answer_of, patience_s=_PATIENCE_S)


class Probes(Protocol):
    """What no file shows, and has to be tried."""

    def can_socket(self) -> None:
        """Make a raw CAN socket; OSError where the kernel does not."""

    def interface(self, name: str) -> InterfaceState:
        """What the kernel knows of a CAN interface."""

    def open_port(self, settings: SerialSettings) -> None:
        """Open and close a serial port as the robot does; OSError."""

    def wake_ups(self, period_ns: int) -> Summary:
        """How late a bare loop wakes up."""

    def write(self, folder: Path) -> WriteSpeed:
        """Write into a folder, and wait until it is on the disk; OSError."""


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
        return self.hardware is not None and self.hardware.can.interface in {"auto", "socketcan"}
