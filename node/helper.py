# SPDX-License-Identifier: MIT
"""Processes of our own that help the loop: started, given their task in one line of JSON, and ended.

Only who starts them needs this: the processes themselves import neither it nor `subprocess`.
"""

import contextlib
import ctypes
import os
import subprocess
import sys
from collections.abc import Sequence
from typing import IO, Final

import msgspec

_SETSID: Final = 0x80
"""POSIX_SPAWN_SETSID of glibc's spawn.h: a session of its own."""
_OPAQUE_BYTES: Final = 1024
"""More than glibc's posix_spawnattr_t and posix_spawn_file_actions_t take (336 and 80)."""
_MESSAGES: Final = 2
_messages: Final = [_MESSAGES]
"""Where helpers write their messages, which is not where a model's are."""


def send_messages_to(descriptor: int) -> None:
    """Have helpers that are started from now on write their messages to this file."""
    _messages[0] = descriptor


def write_message(text: str) -> None:
    """Write a line there at once, as before this process ends itself: what is logged is written a little later."""
    with contextlib.suppress(OSError):  # nobody reads it
        os.write(_messages[0], f"segway-ecc: {text}\n".encode(errors="backslashreplace"))


def start_helper(
    module: str, arguments: Sequence[str], descriptors: Sequence[int], stdout: int | None = None
) -> "subprocess.Popen[bytes]":
    """Start `python -m module` in a session of its own: a signal to the loop's process group does not reach it.

    It has the files of `descriptors` open, by the same numbers; `stdout` is as `subprocess.Popen` takes it.
    """
    return subprocess.Popen(  # noqa: S603 - our own program
        [sys.executable, "-P", "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=stdout,
        stderr=_messages[0],
        start_new_session=True,
        pass_fds=descriptors,
    )


def spawn_helper(module: str, descriptors: Sequence[int]) -> tuple[int, IO[bytes], IO[bytes]]:
    """Start one beside a loop that runs, in a thread of its own: as `start_helper`, and without delaying the loop.

    `subprocess` and `os.posix_spawn` hold the interpreter's lock until the new process has got a processor (115 ms were
    measured on a busy machine); what ctypes calls does not.

    Returns:
        Its process id, and what it reads and writes.

    Raises:
        OSError: It cannot be started.
    """
    libc, pid = ctypes.CDLL(None), ctypes.c_int()
    attributes, actions = (ctypes.create_string_buffer(_OPAQUE_BYTES) for _ in range(2))
    (their_input, our_end), (their_end, their_output) = os.pipe(), os.pipe()
    libc.posix_spawnattr_init(attributes)
    libc.posix_spawnattr_setflags(attributes, ctypes.c_short(_SETSID))
    libc.posix_spawn_file_actions_init(actions)
    for ours, theirs in (
        (their_input, 0),
        (their_output, 1),
        (_messages[0], _MESSAGES),
        *zip(descriptors, descriptors, strict=True),
    ):
        libc.posix_spawn_file_actions_adddup2(actions, ours, theirs)
    words = [os.fsencode(word) for word in (sys.executable, "-P", "-m", module)]
    variables = [key + b"=" + value for key, value in os.environb.items()]
    argv, environment = ((ctypes.c_char_p * (len(texts) + 1))(*texts, None) for texts in (words, variables))
    error = libc.posix_spawn(ctypes.byref(pid), words[0], actions, attributes, argv, environment)
    libc.posix_spawn_file_actions_destroy(actions)
    libc.posix_spawnattr_destroy(attributes)
    os.close(their_input)
    os.close(their_output)
    source, sink = os.fdopen(our_end, "wb"), os.fdopen(their_end, "rb")
    if error:
        source.close()
        sink.close()
        raise OSError(error, os.strerror(error))
    return pid.value, source, sink


def send_task(process: "subprocess.Popen[bytes]", task: msgspec.Struct) -> None:
    """Send it its task as one line of JSON.

    Raises:
        BrokenPipeError: It has ended.
    """
    assert process.stdin is not None  # noqa: S101 - it was asked for when it was started
    process.stdin.write(msgspec.json.encode(task) + b"\n")
    process.stdin.flush()


def end_helper(process: "subprocess.Popen[bytes]", within_s: float) -> int:
    """End its input, by which it knows that it is to end, and kill it where it does not within so long, s.

    Returns its exit status, as `subprocess.Popen` has it.
    """
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):  # what was sent last may have no reader any more
                stream.close()
    try:
        return process.wait(within_s)
    except subprocess.TimeoutExpired:
        process.kill()
        return process.wait()
