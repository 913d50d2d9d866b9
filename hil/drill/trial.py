# SPDX-License-Identifier: MIT
"""The faults of the drill; one of them, done to a robot that drives, and its outcome beside the expected one."""

import contextlib
import enum
import errno
import fcntl
import os
import resource
import signal
import socket
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from segway_ecc.firmware_io.drives.family import family_of
from segway_ecc.hil.drill.parts import (
    DrillSetup,
    Parts,
    new_lines,
    running,
    small_disk,
    stopped,
    wait_until_driven,
)
from segway_ecc.hil.drill.plant_control import Torque, read_trace, torque_after
from segway_ecc.hil.drill.stepped_clock import AHEAD, BACK
from segway_ecc.hil.processes import ProcessFailedError
from segway_ecc.node.config import NoHardwareSection, RobotFile, load_robot

_ANSWERS_WITHIN_S: Final = 5.0
_RECORDER_NOTICES_WITHIN_S: Final = 30.0
_RECORDER_REPORTS: Final = "recorder: Writing the log "
LIMIT_S: Final = 0.05
"""Torque must end within this time of a part that died or was cut off."""
_FROZEN_LIMIT_S: Final = 0.5
"""A sensor that stays as it is looks like one at rest for a while; the same as `hil/scenarios/encoder-stuck.yaml`."""
_ROOM_BYTES: Final = 1 << 16
_FILLING: Final = bytes(1 << 16)
_SIOCGIFFLAGS: Final = 0x8913
_SIOCSIFFLAGS: Final = 0x8914
_IFF_UP: Final = 1
_REQUEST: Final = struct.Struct("16sh22x")
"""`struct ifreq` with the flags."""
GAP_LIMIT_S: Final = 0.1
"""A robot that drives on may be without torque for no longer, as while it passes to its other line."""
_DRIVEN_S: Final = 1.5
_LOOK_S: Final = 1.0
_WATCHDOG_SLACK_S: Final = 0.01
"""For the firmware's own clock, where the watchdog takes longer than torque may otherwise go on."""
_AFTER_S: Final = 0.5
"""Looked on for after a stopped process goes on: what it does then counts too."""
_DISK_BYTES: Final = 4 << 20


@enum.unique
class DrillOutcome(enum.StrEnum):
    """Expected outcome of a fault."""

    ENDS = "torque ends"
    DRIVES_ON = "drives on"


Harm = Callable[[Parts, ExitStack], int]
"""Does the harm; returns when, monotonic, ns. What must be undone goes onto the stack."""


@dataclass(frozen=True, slots=True)
class DrillFault:
    """One way to harm a robot.

    Attributes:
        within_s: Longest time from it to the last torque, where torque is to end, s.
        guard: Whether it needs a guard.
        serial: Whether it needs a serial line to fall back on.
        stepped: Whether it needs wall clocks that can be stepped.
        disk: Whether the log is to be on a disk of its own.
        interface: Whether it needs a network interface, which is set down.
        silences: Whether it silences telemetry alone, which a robot may ride through for a while.
        watchdog: Whether only the drives' own watchdog ends torque, be there a guard or not.
    """

    name: str
    expected: DrillOutcome
    harm: Harm
    within_s: float = LIMIT_S
    guard: bool = False
    serial: bool = False
    stepped: bool = False
    disk: bool = False
    interface: bool = False
    silences: bool = False
    watchdog: bool = False


def _kill(part: str) -> Harm:
    def harm(parts: Parts, _undo: ExitStack) -> int:
        pid = parts.pid(part)
        now_ns = time.monotonic_ns()
        os.kill(pid, signal.SIGKILL)
        return now_ns

    return harm


def _stop(part: str) -> Harm:
    def harm(parts: Parts, undo: ExitStack) -> int:
        pid = parts.pid(part)
        now_ns = time.monotonic_ns()
        undo.enter_context(stopped(pid))
        return now_ns

    return harm


def _request(line: str) -> Harm:
    def harm(parts: Parts, _undo: ExitStack) -> int:
        stamp, _, answer = parts.plant.ask(line, _ANSWERS_WITHIN_S).partition(" ")
        if answer != line:
            raise ProcessFailedError(f"the plant answered '{line}' with '{answer}'")
        return int(stamp)

    return harm


def _set_down(parts: Parts, undo: ExitStack) -> int:
    now_ns = time.monotonic_ns()
    try:
        undo.enter_context(interface_down(parts.setup.channel))
    except OSError as error:
        raise ProcessFailedError(f"cannot set {parts.setup.channel} down: {error.strerror}") from error
    return now_ns


def _step_clock(number: signal.Signals) -> Harm:
    def harm(parts: Parts, _undo: ExitStack) -> int:
        now_ns = time.monotonic_ns()
        for part in (parts.plant, parts.node, parts.guard):
            if part is not None:
                part.process.send_signal(number)
        return now_ns

    return harm


def _fill_disk(parts: Parts, _undo: ExitStack) -> int:
    """Leave no room on the log's disk; where it has none of its own, let the recorder's file grow no more."""
    recorder, folder = parts.pid("recorder"), parts.setup.log_folder
    now_ns = time.monotonic_ns()
    if folder.is_mount():
        with (folder / "filling").open("wb", buffering=0) as file:
            try:
                while True:
                    file.write(_FILLING)
            except OSError as error:
                if error.errno != errno.ENOSPC:
                    raise
    else:
        # Its messages go to a file as well, which must find room.
        size = max(_ROOM_BYTES, *(path.stat().st_size for path in folder.iterdir()))
        resource.prlimit(recorder, resource.RLIMIT_FSIZE, (size, size))
    deadline = time.monotonic() + _RECORDER_NOTICES_WITHIN_S
    while not any(line.startswith(_RECORDER_REPORTS) for line in parts.log_lines()):
        if time.monotonic() > deadline:
            raise ProcessFailedError("the recorder did not notice that the disk is full")
        time.sleep(0.02)
    return now_ns


@contextlib.contextmanager
def interface_down(name: str) -> Iterator[None]:
    """Have a network interface of this machine down (see netdevice(7)), and up again when the context is left.

    Raises:
        OSError: There is none of that name, or we may not.
    """
    flags = _flags(name)
    _set_flags(name, flags & ~_IFF_UP)
    try:
        yield
    finally:
        _set_flags(name, flags | _IFF_UP)


def why_not_down(name: str) -> str | None:
    """Why a network interface cannot be set down here; None where it can. Nothing is changed."""
    try:
        _set_flags(name, _flags(name))
    except OSError as error:
        return f"{name} cannot be set down: {os.strerror(error.errno or 0)}"
    return None


def _flags(name: str) -> int:
    return int(_REQUEST.unpack(_control(_SIOCGIFFLAGS, name, 0))[1])


def _set_flags(name: str, flags: int) -> None:
    _control(_SIOCSIFFLAGS, name, flags)


def _control(request: int, name: str, flags: int) -> bytes:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        return fcntl.ioctl(any_socket, request, _REQUEST.pack(os.fsencode(name)[:15], flags))


FAULTS: Final = {
    fault.name: fault
    for fault in (
        DrillFault("node killed", DrillOutcome.ENDS, _kill("node")),
        DrillFault("node stopped", DrillOutcome.ENDS, _stop("node")),
        DrillFault("guard killed", DrillOutcome.DRIVES_ON, _kill("guard"), guard=True),
        DrillFault("guard stopped", DrillOutcome.DRIVES_ON, _stop("guard"), guard=True),
        DrillFault("recorder killed", DrillOutcome.DRIVES_ON, _kill("recorder")),
        DrillFault("recorder stopped", DrillOutcome.DRIVES_ON, _stop("recorder")),
        DrillFault("drives mute", DrillOutcome.ENDS, _request("mute"), silences=True),
        DrillFault("bus down", DrillOutcome.ENDS, _set_down, interface=True, watchdog=True),
        DrillFault("cable cut", DrillOutcome.ENDS, _request("cut"), watchdog=True),
        DrillFault("cable cut with serial line", DrillOutcome.DRIVES_ON, _request("cut"), serial=True),
        DrillFault("left sensor frozen", DrillOutcome.ENDS, _request("freeze left"), within_s=_FROZEN_LIMIT_S),
        DrillFault("clock an hour ahead", DrillOutcome.DRIVES_ON, _step_clock(AHEAD), stepped=True),
        DrillFault("clock an hour back", DrillOutcome.DRIVES_ON, _step_clock(BACK), stepped=True),
        DrillFault("disk full", DrillOutcome.DRIVES_ON, _fill_disk, disk=True),
    )
}


@dataclass(frozen=True, slots=True)
class DrillResult:
    """The outcome of a fault.

    Attributes:
        torque: What became of the torque; None where the drill failed.
        messages: The messages of node and guard after the fault.
        note: How the harm was done, where that is not plain; or why the drill failed.
        within_s: Longest time to the last torque, where torque was to end, s.
    """

    fault: str
    expected: DrillOutcome
    guard: bool
    torque: Torque | None
    messages: Sequence[str]
    note: str = ""
    within_s: float = LIMIT_S

    @property
    def is_as_expected(self) -> bool:
        """Whether the robot did what it must."""
        if self.torque is None:
            return False
        if self.expected is DrillOutcome.ENDS:
            return self.torque.zero_s is not None and self.torque.last_s <= self.within_s
        return self.torque.zero_s is None and self.torque.gap_s <= GAP_LIMIT_S

    @property
    def outcome(self) -> str:
        """What happened."""
        if self.torque is None:
            return "failed"
        return str(DrillOutcome.DRIVES_ON if self.torque.zero_s is None else DrillOutcome.ENDS)


def run(fault: DrillFault, setup: DrillSetup) -> DrillResult:
    """Start the robot, do the harm and observe it."""
    torque, messages, note = None, list[str](), ""
    try:
        with contextlib.ExitStack() as disk:
            setup.log_folder.mkdir(parents=True, exist_ok=True)
            is_small = fault.disk and disk.enter_context(small_disk(setup.log_folder, _DISK_BYTES))
            with running(setup) as parts:
                wait_until_driven(parts, _DRIVEN_S)
                torque, messages = _harm(fault, parts)
    except ProcessFailedError as error:
        note = str(error)
    else:
        if fault.disk:
            note = (
                "a tmpfs filled to the last byte"
                if is_small
                else "no tmpfs to be had: the recorder's file size limited"
            )
        elif fault.stepped:
            note = "as the processes read it: the machine's own clock is not set"
    within_s = limit_s(fault, load_robot(setup.robot), guard=setup.guard)
    return DrillResult(fault.name, fault.expected, setup.guard, torque, messages, note, within_s)


def limit_s(fault: DrillFault, file: RobotFile, *, guard: bool) -> float:
    """Longest time from a fault to the last torque of a robot, with a guard or without, s."""
    within_s, hardware = fault.within_s, file.hardware
    if isinstance(hardware, NoHardwareSection):
        return within_s
    if fault.silences:
        within_s += hardware.ride_through_s
    timeout_s = family_of(hardware).watchdog(hardware).timeout_s
    if timeout_s > LIMIT_S and (fault.watchdog or not guard):
        within_s = max(within_s, timeout_s + _WATCHDOG_SLACK_S)
    return within_s


def _harm(fault: DrillFault, parts: Parts) -> tuple[Torque, list[str]]:
    before = parts.log_lines()
    with contextlib.ExitStack() as undo:
        fault_ns = fault.harm(parts, undo)
        time.sleep(_LOOK_S)
    time.sleep(_AFTER_S)
    until_ns = time.monotonic_ns()
    torque = torque_after(read_trace(parts.setup.trace), fault_ns, until_ns)
    return torque, new_lines(before, parts.log_lines())


def worst(results: Sequence[DrillResult]) -> DrillResult:
    """The result that counts most against the robot: one not as expected first, then the longest."""

    def badness(result: DrillResult) -> tuple[bool, bool, float]:
        torque = result.torque
        if torque is None:
            return not result.is_as_expected, True, 0.0
        ends = result.expected is DrillOutcome.ENDS
        return not result.is_as_expected, False, torque.last_s if ends else torque.gap_s

    return max(results, key=badness)
