# SPDX-License-Identifier: MIT
"""The faults of the drill, and the outcome that is expected of each."""

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
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final

from segway_ecc.hil.drill.parts import Parts, stopped
from segway_ecc.hil.drill.stepped_clock import AHEAD, BACK
from segway_ecc.hil.processes import ProcessFailedError

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
        DrillFault("drives mute", DrillOutcome.ENDS, _request("mute")),
        DrillFault("bus down", DrillOutcome.ENDS, _set_down, interface=True),
        DrillFault("cable cut", DrillOutcome.ENDS, _request("cut")),
        DrillFault("cable cut with serial line", DrillOutcome.DRIVES_ON, _request("cut"), serial=True),
        DrillFault("left sensor frozen", DrillOutcome.ENDS, _request("freeze left"), within_s=_FROZEN_LIMIT_S),
        DrillFault("clock an hour ahead", DrillOutcome.DRIVES_ON, _step_clock(AHEAD), stepped=True),
        DrillFault("clock an hour back", DrillOutcome.DRIVES_ON, _step_clock(BACK), stepped=True),
        DrillFault("disk full", DrillOutcome.DRIVES_ON, _fill_disk, disk=True),
    )
}
