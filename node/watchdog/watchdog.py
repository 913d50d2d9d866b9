# SPDX-License-Identifier: MIT
"""Keeps watch over a model in this process: starts its watchdog, and gives it what the model prints."""

import contextlib
import ctypes
import faulthandler
import fcntl
import io
import logging
import mmap
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Final, NoReturn

from segway_ecc.node.errors import ConfigurationError, ModelError, printable, shortened
from segway_ecc.node.helper import end_helper, send_messages_to, send_task, start_helper
from segway_ecc.node.model.model import Model
from segway_ecc.node.watchdog.exits import Exits, hand_over_exits
from segway_ecc.node.watchdog.page import Call, CallPage
from segway_ecc.node.watchdog.process import LONG_NS, WatchTask
from segway_ecc.node.watchdog.stand_in import StandIn
from segway_ecc.node.watchdog.watched_model import WatchedModel, end_fork, watched

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer

_MODULE: Final = "segway_ecc.node.watchdog.process"
_OUTPUT: Final = 1
_MESSAGES: Final = 2
_PIPE_BYTES: Final = 1 << 20
"""What a model may print before it is read; any user may have so much (pipe(7))."""
_LINE_BUFFERED: Final = 1
"""_IOLBF of stdio.h: a line that is printed before a crash is not lost with the process."""
_CLOSE_S: Final = 10.0
_PERIODS: Final = 10
_SHORTEST_S: Final = 0.1
_logger = logging.getLogger(__name__)


def step_limit_s(given: float | None, step_size: float) -> float:
    """What a call into a model may take that a cycle waits for, s: as it is given, or ten steps and no less than 0.1 s.

    Raises:
        ConfigurationError: It is shorter than a step.
    """
    if given is not None and given < step_size:
        raise ConfigurationError(f"model.step_limit_s: {given:g} s is less than the model's step of {step_size:g} s")
    return max(_PERIODS * step_size, _SHORTEST_S) if given is None else given


class _Printed(io.FileIO):
    """The pipe to the watchdog: what finds no room in it is lost, and nothing waits."""

    def write(self, data: "ReadableBuffer", /) -> int:
        size = memoryview(data).nbytes
        with contextlib.suppress(OSError):
            super().write(data)
        return size


class ModelWatchdog:
    """The watchdog of the models of this process; see `model_watchdog`."""

    def __init__(self, page: CallPage, process: "subprocess.Popen[bytes]", stand_in: StandIn) -> None:
        """Record calls in `page`, at which `process` looks; at first a model is being loaded."""
        self._page = page
        self._process = process
        self._parent = os.getpid()
        self._stand_in = stand_in

    def load(self, source: str) -> None:
        """The model of this `source` is being loaded, in place of the one before."""
        self._stand_in.name = source
        self._page.enter(Call.LOAD, 0, time.monotonic_ns())
        self._send(WatchTask(source))

    def watch(self, model: Model, limit_ns: int = LONG_NS) -> WatchedModel:
        """The same model, watched: what a call may take that a cycle waits for is `limit_ns`."""
        if os.getpid() != self._parent:
            end_fork(model.name)
        self._stand_in.name, names = model.name, tuple(variable.name for variable in model.inputs)
        self._page.leave()
        self._page.resize(len(names))
        self._send(WatchTask(model.name, names, limit_ns))
        return watched(model, self._page)

    def _send(self, task: WatchTask) -> None:
        with contextlib.suppress(BrokenPipeError):  # it is gone, which is reported
            send_task(self._process, task)

    def end(self) -> None:
        """Nothing is watched any more."""
        self._send(WatchTask(self._stand_in.name, is_over=True))
        end_helper(self._process, _CLOSE_S)
        self._stand_in.end()


@contextlib.contextmanager
def model_watchdog(source: str) -> Iterator[ModelWatchdog]:
    """Watch over the calls into models, and take what they print, while the context lasts.

    Until `ModelWatchdog.watch` is called, the model of this `source` is being loaded.
    """
    memory, pidfd = os.memfd_create("segway-ecc-calls"), os.pidfd_open(os.getpid())
    pipe, printed = os.pipe()
    try:
        os.ftruncate(memory, mmap.PAGESIZE)
        with contextlib.suppress(OSError):  # less is what others have left
            fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
        os.set_blocking(printed, False)
        page = CallPage(memory)
        page.enter(Call.LOAD, 0, time.monotonic_ns())
        name = printable(shortened(source.replace("\0", " ")))  # with the arguments: it may be needed at once
        ours, theirs = socket.socketpair()
        with ours, theirs:
            given = pidfd, memory, pipe, theirs.fileno()
            process = start_helper(_MODULE, (*map(str, given), name), given)
            exits = _handed_over(ours)
        watchdog = ModelWatchdog(page, process, StandIn(process, exits, source))
        try:
            with _captured(printed), _kept_alive():
                yield watchdog
        finally:
            watchdog.end()
    finally:
        for descriptor in (memory, pidfd, pipe, printed):
            os.close(descriptor)


def _handed_over(sink: socket.socket) -> Exits | None:
    """What the watchdog at the other end of `sink` was handed; None where the kernel refuses it, which is reported."""
    try:
        return hand_over_exits(sink)
    except OSError as error:
        _logger.info(
            "a model that ends the process with status 0 gives exit code 0 here, and is reported; torque ends by guard "
            "and drives, as where the node is killed: %s",
            error.strerror,
        )
        return None


@contextlib.contextmanager
def _captured(printed: int) -> Iterator[None]:
    """Send to a pipe what is printed: by C and C++, by Python, and by Python's faulthandler as the process dies."""
    libc, was_enabled = ctypes.CDLL(None), faulthandler.is_enabled()
    ours = {number: os.dup(number) for number in (_OUTPUT, _MESSAGES)}
    _flush(libc)
    for number in ours:
        os.dup2(printed, number)
    send_messages_to(ours[_MESSAGES])
    libc.setvbuf(ctypes.c_void_p.in_dll(libc, "stdout"), None, _LINE_BUFFERED, 0)
    if not was_enabled:
        faulthandler.enable(_MESSAGES, all_threads=False)
    raw = _Printed(printed, "w", closefd=False)
    stream = io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", "backslashreplace", line_buffering=True)
    try:
        with contextlib.redirect_stdout(stream), contextlib.redirect_stderr(stream):
            yield
    finally:
        with contextlib.suppress(ValueError):  # a model may have closed it
            stream.flush()
        _flush(libc)
        if not was_enabled:
            faulthandler.disable()
        send_messages_to(_MESSAGES)
        for number, own in ours.items():
            os.dup2(own, number)
            os.close(own)


@contextlib.contextmanager
def _kept_alive() -> Iterator[None]:
    """Have a model in Python that would end this process at once fail instead."""
    leave, process = os._exit, os.getpid()

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # a fork ends as it is meant to
            leave(status)
        raise ModelError(f"it called os._exit({status}), which would end the process")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = leave


def _flush(libc: ctypes.CDLL) -> None:
    """Write what C and Python have buffered of what was printed."""
    libc.fflush(None)
    for stream in (sys.__stdout__, sys.__stderr__):
        if stream is not None:
            with contextlib.suppress(OSError, ValueError):
                stream.flush()
