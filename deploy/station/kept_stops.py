# SPDX-License-Identifier: MIT
"""The stops that are not confirmed yet, in a file, so that a station that is started again delivers them.

A thread of its own writes the file: nothing else waits for the disk, and a stop is sent before it is written.
"""

import logging
import re
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

import msgspec

from segway_ecc.deploy.release.agent.files import write_whole

NAME: Final = "stops.json"
MOST: Final = 100
"""Robots with a stop that is not confirmed, beside those that were found."""
_LARGEST_BYTES: Final = 1 << 18
_NAMESPACE: Final = re.compile(r"/|(/[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)
_LONGEST_NAMESPACE: Final = 256
_RETRY_S: Final = 1.0
_ENDS_WITHIN_S: Final = 2.0
_logger: Final = logging.getLogger(__name__)


class KeptStop(msgspec.Struct, frozen=True):
    """Who pressed stop, and when, ns since the Unix epoch."""

    who: str
    wall_ns: int


def is_namespace(name: str) -> bool:
    """Whether a robot can have this namespace."""
    return len(name) <= _LONGEST_NAMESPACE and _NAMESPACE.fullmatch(name) is not None


class KeptStops:
    """Keeps what it is given last; `on_disk` is what a station that starts now would find."""

    def __init__(
        self,
        folder: Path,
        log: Callable[[str], None],
        write: Callable[[Path, bytes], None] = lambda path, content: write_whole(path, content, 0o600),
    ) -> None:
        """Keep them in a folder; `log` takes the text of what fails, once."""
        self._path = folder / NAME
        self._log = log
        self._write = write
        self.on_disk: Mapping[str, KeptStop] = {}
        self._wanted: Mapping[str, KeptStop] = {}
        self._changed = threading.Condition()
        self._is_ending = self._has_failed = False
        self._thread = threading.Thread(target=self._run, name="stops", daemon=True)

    def load(self) -> Mapping[str, KeptStop]:
        """What an earlier station kept, by namespace; from then on changes are kept."""
        try:
            with self._path.open("rb") as file:
                found = msgspec.json.decode(file.read(_LARGEST_BYTES), type=dict[str, KeptStop])
            self.on_disk = {name: stop for name, stop in list(found.items())[:MOST] if is_namespace(name)}
        except FileNotFoundError:
            pass
        except (OSError, msgspec.MsgspecError, UnicodeError) as error:
            self._fail(f"{self._path} cannot be read: press stop again for a robot that it was not confirmed of", error)
        self._wanted = self.on_disk
        self._thread.start()
        return self.on_disk

    def keep(self, stops: Mapping[str, KeptStop]) -> None:
        """Keep these from now on; never waits for the disk."""
        if stops != self._wanted:
            with self._changed:
                self._wanted = dict(stops)
                self._changed.notify()

    def close(self) -> None:
        """Write what is not written yet, within a moment."""
        with self._changed:
            self._is_ending = True
            self._changed.notify()
        if self._thread.ident is not None:
            self._thread.join(_ENDS_WITHIN_S)

    def _run(self) -> None:
        while True:
            with self._changed:
                while self._wanted == self.on_disk and not self._is_ending:
                    self._changed.wait()
                wanted, is_ending = self._wanted, self._is_ending
            if wanted != self.on_disk:
                try:
                    self._write(self._path, msgspec.json.encode(wanted))
                    self.on_disk, self._has_failed = wanted, False
                except OSError as error:
                    self._fail(f"{self._path} cannot be written: a stop lasts only as long as this station runs", error)
                    with self._changed:
                        self._changed.wait_for(lambda: self._is_ending, _RETRY_S)
            if is_ending:
                return

    def _fail(self, text: str, error: Exception) -> None:
        if not self._has_failed:
            self._has_failed = True
            text = f"{text} ({getattr(error, 'strerror', None) or error})"
            _logger.error(text)
            self._log(text)
