# SPDX-License-Identifier: MIT
"""The raw traffic on a bus, as a candump log: what can-utils, SavvyCAN and cantools read."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final, Self

import can

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.can_interfaces import check_socketcan, resolve
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.node.errors import RecordingError

_WAIT_S: Final = 0.1


class CandumpLog:
    """Writes frames, and counts them, in the format of `candump -L`, in two files at most that take turns.

    When the file is half as long as all may be, it becomes the older one (`FILE.1`), and the older one before it goes.
    """

    def __init__(self, path: Path, limit_bytes: int) -> None:
        """Begin the file.

        Raises:
            RecordingError: It cannot be written.
        """
        self.frames = 0
        self._path = path
        self._half = limit_bytes // 2
        with self._writing():
            self._writer = can.CanutilsLogWriter(path)

    def write(self, message: can.Message) -> None:
        """Write one frame.

        Raises:
            RecordingError: The disk refuses.
        """
        with self._writing():
            self._writer.on_message_received(message)
            self.frames += 1
            if self._writer.file.tell() >= self._half:
                self._writer.stop()
                self._path.replace(self._path.with_name(f"{self._path.name}.1"))
                self._writer = can.CanutilsLogWriter(self._path)

    def flush(self) -> None:
        """Hand what was written to the kernel.

        Raises:
            RecordingError: The disk refuses.
        """
        with self._writing():
            self._writer.file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(OSError):
            self._writer.stop()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise RecordingError(f"cannot write {self._path}: {error.strerror}; choose another --out") from error


def listen(settings: CanSettings, log: CandumpLog, is_over: Callable[[], bool]) -> None:
    """Write what passes on a bus, from a socket of our own; nothing is ever sent.

    Args:
        settings: Of the bus, as in a robot file.
        log: Where it goes.
        is_over: Asked ten times a second at least.

    Raises:
        BusNotFoundError: The bus is not there, or belongs to one program alone.
        RecordingError: The disk refuses.
    """
    interface, channel = resolve(settings.interface, settings.channel)
    if interface == "socketcan":
        check_socketcan(channel, settings.bitrate, settings.fd_bitrate)
    options: dict[str, Any] = {}
    if settings.fd_bitrate is not None:
        options = {"fd": True, "data_bitrate": settings.fd_bitrate}
    try:
        bus = can.Bus(interface=interface, channel=channel, bitrate=settings.bitrate, **options)
    except Exception as error:  # a driver may raise anything, NameErrors included
        raise BusNotFoundError(f"cannot listen on CAN bus {interface} {channel}: {error}") from error
    with bus:
        flushed_s = time.monotonic()
        while not is_over():
            message = bus.recv(_WAIT_S)
            if message is not None:
                message.channel = channel
                log.write(message)
            if time.monotonic() - flushed_s > _WAIT_S:
                log.flush()
                flushed_s = time.monotonic()
