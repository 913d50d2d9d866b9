# SPDX-License-Identifier: MIT
"""Ends with status 0 are asked for, by a process and by what it starts; all others are not."""

import errno
import os
import select
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from segway_ecc.node.watchdog import exits as module
from segway_ecc.node.watchdog.exits import Exits, receive_exits
from tests.fixtures.refusing import refusing
from tests.patience import PATIENCE_S

ASKS = """
import ctypes, os, signal, socket, subprocess, sys
from segway_ecc.node.watchdog.exits import hand_over_exits
with socket.socket(fileno=int(sys.argv[1])) as sink:
    exits = hand_over_exits(sink)
"""
ABI = {"x86_64": 0xC000003E, "i386": 0x40000003, "aarch64": 0xC00000B7, "arm": 0x40000028}
"""AUDIT_ARCH of linux/audit.h."""
EXIT_GROUPS = {
    "x86_64": [("x86_64", 231), ("x86_64", 0x40000000 + 231), ("i386", 252)],
    "aarch64": [("aarch64", 94), ("arm", 248)],
}
FLAGS = " | ".join(f"SECCOMP_FILTER_FLAG_{name}" for name in ("TSYNC", "SPEC_ALLOW", "NEW_LISTENER", "TSYNC_ESRCH"))
HEADERS = """
#include <asm/unistd.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/ioctl.h>
#include <linux/prctl.h>
#include <linux/seccomp.h>
#include <stddef.h>
#define SAME(ours, theirs) _Static_assert((ours) == (theirs), #theirs)
"""


@contextmanager
def asking(program: str) -> Iterator[tuple["subprocess.Popen[bytes]", Exits]]:
    """A process whose end is asked for, and where."""
    ours, theirs = socket.socketpair()
    with theirs:
        words = [sys.executable, "-P", "-c", f"{ASKS}\n{program}", str(theirs.fileno())]
        process = subprocess.Popen(words, pass_fds=(theirs.fileno(),))
    with process:
        exits = receive_exits(ours.detach())
        assert exits is not None
        yield process, exits
        process.kill()
        os.close(exits.descriptor)


def answer_once(exits: Exits, *, is_allowed: bool) -> list[int]:
    """Wait until one asks; returns who did."""
    asked: list[int] = []

    def keep(thread: int) -> bool:
        asked.append(thread)
        return is_allowed

    assert select.select([exits.descriptor], [], [], PATIENCE_S)[0]
    assert exits.answer(keep) == is_allowed
    return asked


@pytest.mark.parametrize("program", ["sys.exit(0)", "os._exit(256)", "os.execv('/bin/true', ['true'])"])
def test_an_end_with_status_0_waits_until_it_is_allowed(program: str) -> None:
    with asking(program) as (process, exits):
        assert answer_once(exits, is_allowed=True) == [process.pid]
        assert process.wait(PATIENCE_S) == 0


def test_an_end_that_is_refused_waits_for_a_signal() -> None:
    with asking("os._exit(0)") as (process, exits):
        assert answer_once(exits, is_allowed=False) == [process.pid]
        process.send_signal(signal.SIGABRT)
        assert process.wait(PATIENCE_S) == -signal.SIGABRT


@pytest.mark.parametrize(("program", "code"), [("os._exit(3)", 3), ("os.abort()", -signal.SIGABRT)])
def test_any_other_end_is_not_asked_for(program: str, code: int) -> None:
    with asking(program) as (process, exits):
        assert process.wait(PATIENCE_S) == code
        assert exits.answer(lambda _thread: pytest.fail("nobody asks"))


def test_a_process_that_it_starts_asks_by_its_own_number() -> None:
    with asking("os._exit(7 + subprocess.run(['/bin/true']).returncode)") as (process, exits):
        assert answer_once(exits, is_allowed=True) != [process.pid]
        assert process.wait(PATIENCE_S) == 7


def test_all_who_ask_later_are_allowed_until_nobody_is_left() -> None:
    with asking("os._exit(subprocess.run(['/bin/true']).returncode)") as (process, exits):
        exits.answer_to_the_end()
        assert process.wait(PATIENCE_S) == 0
        _, status = os.waitpid(-1, 0)  # the process that answered
        assert status == 0


def test_where_nothing_was_handed_over_there_is_nothing_to_answer() -> None:
    ours, theirs = socket.socketpair()
    theirs.close()
    assert receive_exits(ours.detach()) is None


def test_a_process_lets_itself_and_what_it_starts_end_where_nobody_else_is_left() -> None:
    ends = "exits.answer_until_this_ends(); sys.exit(subprocess.run(['/bin/true']).returncode)"
    with asking(ends) as (process, exits):
        assert process.wait(PATIENCE_S) == 0
        poll = select.poll()
        poll.register(exits.descriptor, 0)
        assert poll.poll(1e3 * PATIENCE_S) == [(exits.descriptor, select.POLLHUP)], "who answered has ended too"


def test_whoever_is_asked_already_stays_it() -> None:
    again = "try:\n    hand_over_exits(None)\nexcept OSError as error:\n    os._exit(error.errno)"
    with asking(again) as (process, _exits):
        assert process.wait(PATIENCE_S) == errno.EBUSY


@pytest.mark.parametrize("error", ["EPERM", "ENOSYS"])
def test_where_the_kernel_refuses_it_that_is_its_error(error: str) -> None:
    tries = "from segway_ecc.node.watchdog.exits import ask_before_exit\nask_before_exit()"
    words = refusing(error, sys.executable, "-P", "-c", tries)
    refused = subprocess.run(words, check=False, capture_output=True, text=True)
    number = getattr(errno, error)
    assert refused.stderr.splitlines()[-1].endswith(f"[Errno {number}] {os.strerror(number)}")


def decided(code: bytes, number: int, arch: int, status: int) -> int:
    """What a filter returns of a system call, as bpf(4) has its instructions."""
    data = struct.pack("=iIQ6Q", number, arch, 0, status, *(0,) * 5)
    steps, place, held = list(struct.iter_unpack("=HBBI", code)), 0, 0
    while True:
        operation, if_true, if_false, value = steps[place]
        place += 1
        if operation == 0x20:  # BPF_LD | BPF_W | BPF_ABS
            (held,) = struct.unpack_from("=I", data, value)
        elif operation == 0x06:  # BPF_RET | BPF_K
            return int(value)
        else:  # BPF_JMP | BPF_K with BPF_JEQ, or BPF_JSET
            assert operation in {0x15, 0x45}
            place += if_true if (held == value if operation == 0x15 else held & value) else if_false


@pytest.mark.parametrize("machine", EXIT_GROUPS)
def test_filter_of_each_processor_asks_for_exit_groups_with_status_0_alone(machine: str) -> None:
    code = module._instructions(module._EXIT_GROUPS[machine])
    asks = [
        (abi, number)
        for abi, arch in ABI.items()
        for number in (*range(600), *(0x40000000 + number for number in range(600)))
        if decided(code, number, arch, 0) != module._ALLOW
    ]
    assert asks == [(abi, number) for abi in ABI for each, number in EXIT_GROUPS[machine] if each == abi]
    for abi, number in EXIT_GROUPS[machine]:
        found = [decided(code, number, ABI[abi], status) for status in (0, 256, 1 << 32, 1, 3, 255, 0xFFFFFFFF)]
        assert found == [module._ASK] * 3 + [module._ALLOW] * 4


@pytest.mark.parametrize(
    ("compiler", "machine"),
    [
        pytest.param("cc", os.uname().machine, marks=pytest.mark.compiler),
        pytest.param("aarch64-linux-gnu-gcc", "aarch64", marks=pytest.mark.arm64),
    ],
)
def test_numbers_are_those_of_the_kernel_s_headers(compiler: str, machine: str) -> None:
    (arch, exit_group), *others = module._EXIT_GROUPS[machine]
    checks = [
        (arch, f"AUDIT_ARCH_{machine.upper()}"),
        (exit_group, "__NR_exit_group"),
        (others[-1][0], {"x86_64": "AUDIT_ARCH_I386", "aarch64": "AUDIT_ARCH_ARM"}[machine]),
        (module._SECCOMP[machine], "__NR_seccomp"),
        (module._SET_MODE_FILTER, "SECCOMP_SET_MODE_FILTER"),
        (module._FLAGS, FLAGS),
        (module._PR_SET_NO_NEW_PRIVS, "PR_SET_NO_NEW_PRIVS"),
        (module._LOAD, "BPF_LD | BPF_W | BPF_ABS"),
        (module._EQUAL, "BPF_JMP | BPF_JEQ | BPF_K"),
        (module._ANY_BIT, "BPF_JMP | BPF_JSET | BPF_K"),
        (module._RETURN, "BPF_RET | BPF_K"),
        (module._NUMBER, "offsetof(struct seccomp_data, nr)"),
        (module._ARCH, "offsetof(struct seccomp_data, arch)"),
        (module._STATUS, "offsetof(struct seccomp_data, args)"),
        (module._ASK, "SECCOMP_RET_USER_NOTIF"),
        (module._ALLOW, "SECCOMP_RET_ALLOW"),
        (module._GO_ON, "SECCOMP_USER_NOTIF_FLAG_CONTINUE"),
        (module._NOTICE.size, "sizeof(struct seccomp_notif)"),
        (module._ANSWER.size, "sizeof(struct seccomp_notif_resp)"),
        (module._RECEIVE, "SECCOMP_IOCTL_NOTIF_RECV"),
        (module._SEND, "SECCOMP_IOCTL_NOTIF_SEND"),
    ]
    source = HEADERS + "".join(f"SAME({ours}U, {theirs});\n" for ours, theirs in checks)
    words = [compiler, "-fsyntax-only", "-x", "c", "-"]
    done = subprocess.run(words, check=False, input=source, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
