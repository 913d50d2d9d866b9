# SPDX-License-Identifier: MIT
"""Processes of our own that help the loop: started, given their task in one line of JSON, and ended.

Only who starts them needs this: the processes themselves import neither it nor `subprocess`.
"""

import contextlib
import subprocess
import sys
from collections.abc import Sequence

import msgspec


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
        start_new_session=True,
        pass_fds=descriptors,
    )


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
