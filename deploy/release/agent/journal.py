# SPDX-License-Identifier: MIT
"""Where an update stands: a file, for whoever comes after a power cut, and events for the machine that asked."""

import contextlib
import dataclasses
import datetime as dt
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final

from segway_ecc.deploy.release.agent.files import sync_folder, write_whole

PENDING: Final = "transaction.json"
LAST: Final = "last-transaction.json"
WENT_BACK: Final = "went-back"
NO_WAY_BACK: Final = "no-way-back"


def stamp() -> str:
    """Now, as ISO 8601 in UTC."""
    return dt.datetime.now(dt.UTC).isoformat(timespec="microseconds")


@dataclass(frozen=True, slots=True)
class Transaction:
    """One change of the release in use.

    Attributes:
        kind: `push` or `rollback`.
        release: The release that comes into use.
        previous: The one that was in use, and that it goes back to; None where there is none to go back to.
        by: Who asked for it.
        began: When, ISO 8601, UTC.
        phase: What is being done.
        outcome: How it ended; empty while it has not: `healthy`, `went-back`, `no-way-back` or `interrupted`.
        reason: Why it ended so.
        ended: When.
    """

    kind: str
    release: str
    previous: str | None
    by: str
    began: str
    phase: str = "switch"
    outcome: str = ""
    reason: str = ""
    ended: str = ""


class Journal:
    """The transaction under way and the last that ended, in the folder of releases."""

    def __init__(self, root: Path) -> None:
        self._root = root

    def pending(self) -> Transaction | None:
        """The transaction under way, or that was interrupted."""
        return _read(self._root / PENDING)

    def last(self) -> Transaction | None:
        """The last that ended."""
        return _read(self._root / LAST)

    def write(self, transaction: Transaction) -> None:
        """Put down where it stands."""
        write_whole(self._root / PENDING, json.dumps(dataclasses.asdict(transaction), indent=1).encode())

    def close(self) -> None:
        """The transaction under way has ended."""
        (self._root / PENDING).replace(self._root / LAST)
        sync_folder(self._root)


def _read(path: Path) -> Transaction | None:
    try:
        found = json.loads(path.read_bytes())
        # What another version of this program wrote may hold more.
        return Transaction(**{field.name: found[field.name] for field in dataclasses.fields(Transaction)})
    except (OSError, ValueError, TypeError, KeyError):
        return None


class Reporter:
    """Writes events, one JSON object a line; while it is attached, a listener that has gone ends what is going on."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._is_attached = True

    def detach(self) -> None:
        """From now on it does not matter whether anybody listens."""
        self._is_attached = False

    def step(self, name: str) -> None:
        """A step begins."""
        self.event("step", step=name)

    def event(self, event: str, **values: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Send an event."""
        line = json.dumps({"event": event, **values}).encode() + b"\n"
        with contextlib.suppress(*(() if self._is_attached else (OSError, ValueError))):
            self._stream.write(line)
            self._stream.flush()
