# SPDX-License-Identifier: MIT
"""Work with a model in a process of its own: one that crashes, or ends its process, ends no more than that."""

import contextlib
import os
import pickle
import select
import signal
import sys
import traceback
from collections.abc import Callable
from typing import Any, Final, NoReturn, TypeVar

from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.node.errors import ModelError, NodeError
from segway_ecc.node.helper import send_messages_to
from segway_ecc.node.parent import end_with

_T = TypeVar("_T")
_PIECE: Final = 1 << 20
_BY_SIGNAL: Final = 128
_OWN: Final = b"segway-ecc: "
"""Before each line of ours."""
_FAILED: Final = 70
"""The status of a process in which something of ours failed, whose traceback is on standard error."""


class EndedError(ModelError):
    """A model has ended the process that it ran in; the exit code is 128 + N where signal N did."""


def run_apart(work: Callable[[], _T]) -> _T:
    """Have `work` done by a fork of this process, and return what it returns, which can be pickled.

    What the watchdogs in it write goes to standard error.

    Raises:
        EndedError: The process ended meanwhile: with what a watchdog reported of it.
        SegwayEccError: One that the work raised, with its text and its exit code.
    """
    sys.stdout.flush()
    (source, sink), (reports, messages) = os.pipe(), os.pipe()
    parent, pid = os.getpid(), os.fork()
    if pid == 0:
        send_messages_to(messages)
        _be_worker(work, sink, parent)
    os.close(sink)
    os.close(messages)
    try:
        received, report = _receive(source, reports)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)  # it has ended, unless we were interrupted
        status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
        os.close(source)
        os.close(reports)
    if received and status == 0:
        sys.stderr.write(report)
        found, error, exit_code = pickle.loads(received)  # noqa: S301 - of our own fork
        if error:
            raise _with_code(NodeError, exit_code)(error)
        result: _T = found
        return result
    if status == _FAILED:
        raise NodeError("it failed unexpectedly, as above")
    ended = signal.Signals(-status).name if status < 0 else f"exit code {status}"
    text = report.rstrip("\n").removeprefix(_OWN.decode()) or f"the model's process ended by {ended}"
    raise _with_code(EndedError, _BY_SIGNAL - status if status < 0 else ModelError.exit_code)(text)


def _with_code(kind: type[NodeError], exit_code: int) -> type[NodeError]:
    return type(kind.__name__, (kind,), {"exit_code": exit_code})


def _be_worker(work: Callable[[], Any], sink: int, parent: int) -> NoReturn:
    leave, code = os._exit, _FAILED  # before a model's watchdog has it refused
    try:
        end_with(parent)
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # who started us ends us
        try:
            found = work(), "", 0
        except SegwayEccError as error:
            found = None, str(error), error.exit_code
        with open(sink, "wb", closefd=False) as file:
            file.write(pickle.dumps(found))
        code = 0
    except BaseException:  # noqa: BLE001 - nothing may return from here into the caller's program
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        leave(code)


def _receive(source: int, reports: int) -> tuple[bytes, str]:
    """What was handed over, and the last line that was written; the others are passed on as they come."""
    received, held, open_ends = b"", b"", {source, reports}
    while open_ends:
        for end in select.select(list(open_ends), [], [])[0]:
            piece = os.read(end, _PIECE)
            if not piece:
                open_ends.remove(end)
            elif end == source:
                received += piece
            else:
                *lines, last = (held + piece).splitlines(keepends=True)
                held = last
                sys.stderr.write(b"".join(lines).decode(errors="replace"))
    return received, held.decode(errors="replace")
