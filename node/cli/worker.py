# SPDX-License-Identifier: MIT
"""Work in a process of its own, for what may hang in a library: a signal ends it all the same.

A signal handler of Python runs between two instructions of the main thread, and a thread of Python while it has the
interpreter's lock: a call of DDS that hangs keeps both from it. A timer of this process would end it without its
result or its error, and also where it was only stopped for a while. Another process has none of this.
"""

import contextlib
import math
import os
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from typing import Any, Final, NoReturn

import msgspec

from segway_ecc.firmware_io.errors import SegwayEccError
from segway_ecc.node.cli.options import stopped_by_signals
from segway_ecc.node.errors import AbandonedError, NodeError
from segway_ecc.node.parent import end_with

_LOOK_S: Final = 0.1
_ENDS_S: Final = 10.0
"""From a signal to the end: cancelling a sequence takes 2 s at most, leaving ROS 4 s."""
_LEAVES_S: Final = 4.0
"""From the result to the end: where several nodes left ROS at once, Fast DDS was seen to go round in circles."""
_PIECE: Final = 1 << 16


class _Result(msgspec.Struct, frozen=True):
    found: Any = None
    error: str = ""
    exit_code: int = 0


class Worker:
    """Where the work is done."""

    def __init__(self, signals: list[str], sink: int) -> None:
        """Report through the pipe `sink`; `signals` are those that came."""
        self._signals = signals
        self._sink = sink

    def stopped(self) -> str | None:
        """The signal that is to end the work, or None."""
        return self._signals[0] if self._signals else None

    def finish(self, found: object) -> None:
        """Hand over what the work found, as JSON: all that comes afterwards has a few seconds."""
        self._send(_Result(found))

    @contextlib.contextmanager
    def reporting(self) -> Iterator[None]:
        """Hand over an error of ours instead of raising it."""
        try:
            yield
        except SegwayEccError as error:
            self._send(_Result(error=str(error), exit_code=error.exit_code))

    def _send(self, result: _Result) -> None:
        with open(self._sink, "wb", closefd=False) as sink:
            sink.write(msgspec.json.encode(result) + b"\n")


def run_in_worker(work: Callable[[Worker], None]) -> Any:  # noqa: ANN401 - what JSON holds
    """Have `work` done by a process of its own; returns what it hands over.

    A first signal is passed on to it; a second one, and the end of this process, end it at once.

    Raises:
        AbandonedError: A signal ended it.
        NodeError: With the text and the exit code of its own error, or it ended without a result.
    """
    signals: list[str] = []
    sys.stdout.flush()
    source, sink = os.pipe()
    with stopped_by_signals(signals.append):
        watcher, pid = os.getpid(), os.fork()
        if pid == 0:
            _be_worker(work, Worker(signals, sink), watcher)
        os.close(sink)
        try:
            result = _read_result(pid, source, signals)
            select.select([source], [], [], _LEAVES_S)  # at its end
        finally:
            os.kill(pid, signal.SIGKILL)  # it is there until it is waited for
            os.waitpid(pid, 0)
            os.close(source)
    if result.error:
        raise type("WorkerError", (NodeError,), {"exit_code": result.exit_code})(result.error)
    return result.found


def _be_worker(work: Callable[[Worker], None], worker: Worker, watcher: int) -> NoReturn:
    try:
        os.setsid()  # a terminal's Ctrl-C comes through who watches, and once
        end_with(watcher)
        with worker.reporting():
            work(worker)
    except BaseException:  # noqa: BLE001 - nothing may return from here into the caller's program
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(0)


def _read_result(pid: int, source: int, signals: list[str]) -> _Result:
    received, deadline_s = b"", math.inf
    while not received.endswith(b"\n"):
        if signals and deadline_s == math.inf:
            os.kill(pid, signal.Signals[signals[0]])
            deadline_s = time.monotonic() + _ENDS_S
        if len(signals) > 1 or time.monotonic() > deadline_s:
            raise AbandonedError(
                f"abandoned by {signals[-1]} before ROS had let go: whether the robot was stopped is not known"
            )
        if select.select([source], [], [], _LOOK_S)[0]:
            piece = os.read(source, _PIECE)
            if not piece:
                raise NodeError("the process that speaks ROS for this command has ended unexpectedly; try again")
            received += piece
    return msgspec.json.decode(received, type=_Result)
