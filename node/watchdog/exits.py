# SPDX-License-Identifier: MIT
"""Has the kernel ask the model's watchdog before this process, or one that it starts, ends with status 0.

However a model ends the process with a status of its own, the kernel sees one system call, exit_group: a filter of
seccomp has those with status 0 wait for an answer (seccomp_unotify(2)). The watchdog refuses one in the process that it
watches, and lets the others end. No other system call is slower: the kernel knows which ones a filter never looks at.

A filter stays to the end of a process, and is inherited. Whoever answers does so until nobody is left to ask.
"""

import ctypes
import errno
import fcntl
import os
import platform
import re
import select
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Final

_KERNEL: Final = 5, 9
"""The first that reports that nobody is left to ask."""
_EXIT_GROUPS: Final = {
    "x86_64": ((0xC000003E, 231), (0xC000003E, 0x40000000 | 231), (0x40000003, 252)),
    "aarch64": ((0xC00000B7, 94), (0x40000028, 248)),
}
"""AUDIT_ARCH of linux/audit.h and the number of exit_group, of each ABI that a process may call the kernel by.

Those are 64 bits, on x86-64 also x32 (__X32_SYSCALL_BIT), and 32 bits: i386, as `int 0x80` has it, and EABI
(arch/arm/tools/syscall.tbl of Linux 6).
"""
_SECCOMP: Final = {"x86_64": 317, "aarch64": 277}
"""The number of the system call, for which the C library has no function."""
_SET_MODE_FILTER: Final = 1
_FLAGS: Final = 1 << 0 | 1 << 2 | 1 << 3 | 1 << 4
"""For all threads (TSYNC, and its errors apart), without measures against speculation, with a listener."""
_PR_SET_NO_NEW_PRIVS: Final = 38

_LOAD, _EQUAL, _ANY_BIT, _RETURN = 0x20, 0x15, 0x45, 0x06
"""BPF_LD|W|ABS; BPF_JMP|JEQ|K; BPF_JMP|JSET|K; BPF_RET|K."""
_NUMBER, _ARCH, _STATUS = 0, 4, 16
"""Where struct seccomp_data has them (both processors are little-endian)."""
_ASK, _ALLOW = 0x7FC00000, 0x7FFF0000

_NOTICE: Final = struct.Struct("=QII64x")
"""struct seccomp_notif: its number, the thread that asks, flags; then struct seccomp_data."""
_ANSWER: Final = struct.Struct("=QqiI")
"""struct seccomp_notif_resp: the number, a value, an error, flags."""
_GO_ON: Final = 1
"""SECCOMP_USER_NOTIF_FLAG_CONTINUE: the system call is made as it is."""
_GONE: Final = {errno.ENOENT, errno.EINTR}
"""It has been ended while it waited, or a signal has come to one of both."""
_MOST_DESCRIPTORS: Final = 1 << 16


def _request(number: int, size: int) -> int:
    """_IOWR('!', number, size) of linux/seccomp.h."""
    return 3 << 30 | size << 16 | ord("!") << 8 | number


_RECEIVE: Final = _request(0, _NOTICE.size)
_SEND: Final = _request(1, _ANSWER.size)


class _Program(ctypes.Structure):
    """struct sock_fprog of linux/filter.h."""

    _fields_ = (("length", ctypes.c_ushort), ("instructions", ctypes.c_char_p))


def _instructions(exit_groups: Sequence[tuple[int, int]]) -> bytes:
    steps = []
    for place, (arch, exit_group) in enumerate(exit_groups):
        to_status = 4 * (len(exit_groups) - place) - 3
        steps += [
            (_LOAD, 0, 0, _ARCH),
            (_EQUAL, 0, 2, arch),
            (_LOAD, 0, 0, _NUMBER),
            (_EQUAL, to_status, 0, exit_group),
        ]
    steps += [
        (_RETURN, 0, 0, _ALLOW),
        (_LOAD, 0, 0, _STATUS),
        (_ANY_BIT, 1, 0, 0xFF),  # all that a parent gets to see of it
        (_RETURN, 0, 0, _ASK),
        (_RETURN, 0, 0, _ALLOW),
    ]
    return b"".join(struct.pack("=HBBI", *step) for step in steps)


def ask_before_exit() -> int:
    """Have each end of this process with status 0 wait for an answer; returns the descriptor where it is asked for.

    Raises:
        OSError: The kernel does not do it, or something else answers for this process already.
    """
    machine = platform.machine()
    kernel = tuple(int(number) for number in re.findall(r"\d+", os.uname().release)[:2])
    if machine not in _EXIT_GROUPS or kernel < _KERNEL:
        raise OSError(errno.ENOSYS, os.strerror(errno.ENOSYS))
    libc = ctypes.CDLL(None, use_errno=True)
    code = _instructions(_EXIT_GROUPS[machine])
    program = _Program(len(code) // 8, code)
    for is_privileged in (True, False):
        if not is_privileged:  # the kernel's condition: what is started from now on gains no rights of a file's
            libc.prctl(_PR_SET_NO_NEW_PRIVS, *map(ctypes.c_ulong, (1, 0, 0, 0)))
        number = ctypes.c_long(_SECCOMP[machine])
        asked = libc.syscall(number, ctypes.c_uint(_SET_MODE_FILTER), ctypes.c_uint(_FLAGS), ctypes.byref(program))
        if asked >= 0:
            return int(asked)
        if ctypes.get_errno() != errno.EACCES:
            break
    raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


class Exits:
    """The ends that somebody asks for, at a descriptor of `ask_before_exit`."""

    def __init__(self, descriptor: int) -> None:
        """Answer for all who ask there."""
        self.descriptor = descriptor
        self._poll = select.poll()
        self._poll.register(descriptor, select.POLLIN)

    def answer(self, is_allowed: Callable[[int], bool]) -> bool:
        """Let the thread end its process that asks, if one does, and is allowed by its number; False where it is not.

        Nothing is answered where it is not allowed: the process waits until it is ended.
        """
        if not self.is_asked(0.0):
            return True
        notice = bytearray(_NOTICE.size)
        try:
            fcntl.ioctl(self.descriptor, _RECEIVE, notice)
            asks, thread, _flags = _NOTICE.unpack(notice)
            if not is_allowed(thread):
                return False
            fcntl.ioctl(self.descriptor, _SEND, bytearray(_ANSWER.pack(asks, 0, 0, _GO_ON)))
        except OSError as error:
            if error.errno not in _GONE:
                raise
        return True

    def is_asked(self, within_s: float) -> bool:
        """Whether somebody asks, or does so within this time, s."""
        return any(event & select.POLLIN for _, event in self._poll.poll(1e3 * within_s))

    def answer_to_the_end(self) -> None:
        """Allow all, in a process of its own, which lasts until nobody is left who might ask."""
        if os.fork():
            return
        try:
            _close_all_but(self.descriptor)
            while self._poll.poll()[0][1] & select.POLLIN:
                self.answer(lambda _thread: True)
        finally:
            os._exit(0)

    def answer_until_this_ends(self) -> None:
        """Allow all, in a process of its own, which lasts as long as this one, that may be among those who ask.

        Such a process is one who might ask, too: it never sees that nobody else is left.
        """
        ours = os.pidfd_open(os.getpid())
        if os.fork():
            os.close(ours)
            return
        try:
            _close_all_but(self.descriptor, ours)
            poll = select.poll()
            poll.register(self.descriptor, select.POLLIN)
            poll.register(ours, select.POLLIN)
            while ours not in [place for place, _ in poll.poll()]:
                self.answer(lambda _thread: True)
        finally:
            os._exit(1)  # of which nobody is asked

    def close(self) -> None:
        """Answer no more."""
        os.close(self.descriptor)


def _close_all_but(*kept: int) -> None:
    first = 0
    for descriptor in (*sorted(kept), _MOST_DESCRIPTORS):
        os.closerange(first, descriptor)
        first = descriptor + 1


def hand_over_exits(sink: socket.socket) -> Exits:
    """Have each end with status 0 asked for from now on, of whoever has the other end of `sink`.

    Returns:
        The same, for this process to answer should that one end: with nobody there, the kernel fails the call, and the
        C library then ends the process by SIGSEGV.

    Raises:
        OSError: As `ask_before_exit` does.
    """
    exits = Exits(ask_before_exit())
    socket.send_fds(sink, [b"\0"], [exits.descriptor])
    return exits


def receive_exits(source: int) -> Exits | None:
    """What was handed over to this file descriptor of a socket; None where the other end was closed instead."""
    with socket.socket(fileno=source) as handed:
        _, descriptors, _, _ = socket.recv_fds(handed, 1, 1)
    return Exits(descriptors[0]) if descriptors else None
