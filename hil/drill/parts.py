# SPDX-License-Identifier: MIT
"""The processes of a robot that drives: plant, guard, node and the node's recorder."""

import contextlib
import os
import signal
import subprocess
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.firmware_io.build import imu_line
from segway_ecc.firmware_io.settings import BusSettings, HardwareSettings
from segway_ecc.hil.drill.plant_control import driven_since_ns, read_trace
from segway_ecc.hil.process_usage import helpers_of
from segway_ecc.hil.processes import Command, ProcessFailedError, command
from segway_ecc.node.sequence.manoeuvre import Manoeuvre, Segment

STEPPED: Final = "segway_ecc.hil.drill.stepped_clock"
_COMMAND: Final = "segway_ecc.node.cli.main"
_SEGMENTS: Final = (
    Segment(linear=0.6, angular=0.3, duration=1.0),
    Segment(linear=0.3, angular=-0.3, duration=1.0),
)
"""Never at rest and never steady: what is measured keeps changing."""
_TIMES: Final = 100
_STARTS_WITHIN_S: Final = 30.0
_POLL_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class DrillSetup:
    """What is started.

    Attributes:
        robot: A robot file, or the name of one that ships with the package.
        bus: The options that name the lines, which all processes share; the last word is the name of the drives'.
        serial: Whether a serial line is made for the drives.
        stepped: Whether the wall clocks that the processes read can be stepped.
        folder: Where messages, traces and the serial line go.
        node: Options of the node, in place of a sequence that it drives without ROS.
    """

    robot: str
    bus: Sequence[str]
    serial: bool
    guard: bool
    stepped: bool
    folder: Path
    node: Sequence[str] = ()

    @property
    def channel(self) -> str:
        """The name of the drives' line."""
        return self.bus[-1]

    @property
    def trace(self) -> Path:
        """What the motors gave."""
        return self.folder / "trace.csv"

    @property
    def log_folder(self) -> Path:
        """A folder for the node's log alone."""
        return self.folder / "log"

    def messages(self, part: str) -> Path:
        """The messages of a process."""
        return self.folder / f"{part}.txt"


@dataclass(frozen=True, slots=True)
class Parts:
    """What runs."""

    setup: DrillSetup
    plant: Command
    guard: Command | None
    node: Command

    def pid(self, part: str) -> int:
        """The process of `node`, `guard` or `recorder`, which writes the node's log.

        Raises:
            ProcessFailedError: There is none.
        """
        if part == "recorder":
            pid = helpers_of(self.node.process.pid).get(part)
        else:
            process = self.node if part == "node" else self.guard
            pid = None if process is None else process.process.pid
        if pid is None:
            raise ProcessFailedError(f"there is no {part}")
        return pid

    def log_lines(self) -> list[str]:
        """The messages of node and guard so far, in the order of the processes."""
        parts = ("node",) if self.guard is None else ("node", "guard")
        return [
            (line if part == "node" else f"{part}: {line}").replace("segway-ecc: ", "", 1)
            for part in parts
            for line in self.setup.messages(part).read_text(errors="replace").splitlines()
        ]


def lines_of_its_own(hardware: HardwareSettings, folder: Path, bus: Sequence[str]) -> list[str]:
    """The options that name a robot's lines: those of a bus, or serial lines in `folder`; see `DrillSetup.bus`."""
    imu = [] if imu_line(hardware) is None else ["--imu-serial", str(folder / "imu")]
    return [*imu, *(bus if isinstance(hardware, BusSettings) else ("--serial", str(folder / "serial")))]


def new_lines(before: Sequence[str], now: Sequence[str]) -> list[str]:
    """The messages that have come since, where several processes write."""
    known, new = Counter(before), list[str]()
    for line in now:
        if known[line]:
            known[line] -= 1
        else:
            new.append(line)
    return new


@contextlib.contextmanager
def running(setup: DrillSetup) -> Iterator[Parts]:
    """Start everything; leave it when the context ends, stopped processes included."""
    setup.log_folder.mkdir(exist_ok=True)
    module = STEPPED if setup.stepped else _COMMAND
    robot = [setup.robot, *setup.bus, *(["--serial", str(setup.folder / "serial")] if setup.serial else [])]
    sequence = setup.folder / "sequence.yaml"
    sequence.write_bytes(msgspec.yaml.encode(Manoeuvre(segments=_SEGMENTS * _TIMES)))
    with contextlib.ExitStack() as stack:

        def start(part: str, *words: str, listens: bool = False) -> Command:
            return stack.enter_context(command(words, setup.messages(part), module=module, listens=listens))

        plant = start("plant", "plant", *robot, "--control", "--trace", str(setup.trace), listens=True)
        plant.ask("heal", _STARTS_WITHIN_S)  # it answers once it runs
        guard = start("guard", "guard", *robot) if setup.guard else None
        log = str(setup.log_folder / "run.mcap")
        words = setup.node or ("--no-ros", "--sequence", str(sequence))
        node = start("node", "run", *robot, *words, "--log", log)
        yield Parts(setup, plant, guard, node)


def wait_until_driven(parts: Parts, driven_s: float) -> None:
    """Wait until the motors have been driven for a while.

    Raises:
        ProcessFailedError: They were not, in time.
    """
    deadline = time.monotonic() + _STARTS_WITHIN_S
    while (since_ns := driven_since_ns(read_trace(parts.setup.trace))) is None:
        if time.monotonic() > deadline or parts.node.process.poll() is not None:
            raise ProcessFailedError(f"the robot does not drive: {' | '.join(parts.log_lines()) or 'it wrote nothing'}")
        time.sleep(_POLL_S)
    time.sleep(max(since_ns * 1e-9 + driven_s - time.monotonic(), 0.0))
    if parts.guard is not None and parts.guard.process.poll() is not None:
        raise ProcessFailedError(f"the guard has ended: {' | '.join(parts.log_lines())}")


@contextlib.contextmanager
def stopped(pid: int) -> Iterator[None]:
    """Have a process stopped, and go on when the context is left."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


@contextlib.contextmanager
def small_disk(folder: Path, size_bytes: int) -> Iterator[bool]:
    """A small file system at `folder`, where we may mount one; else False, and nothing has changed."""
    words = ["mount", "-t", "tmpfs", "-o", f"size={size_bytes}", "tmpfs", str(folder)]
    mounted = os.geteuid() == 0 and _succeeds(words)
    try:
        yield mounted
    finally:
        if mounted:
            _succeeds(["umount", "-l", str(folder)])


def _succeeds(words: Sequence[str]) -> bool:
    try:
        return subprocess.run(words, check=False, capture_output=True).returncode == 0  # noqa: S603 - no shell reads it
    except OSError:
        return False
