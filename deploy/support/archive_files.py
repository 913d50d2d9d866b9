# SPDX-License-Identifier: MIT
"""A folder of logs, and how a robot's files travel over ROS 2: as the read-only parameters of a node named `archive`.

The service is the standard `rcl_interfaces/srv/GetParameters`, which every ROS 2 installation has because rclpy itself
needs it; `ros2 service call` shows what there is without any code of ours. One request brings one piece, and the next
one is asked for when it is here: that is the flow control.

A piece is a list of 64-bit integers, the first of which counts the bytes; the others hold them, eight each, least
significant first. A byte array would be plainer, but rclpy makes a Python object of each of its bytes: 6.3 ms for a
piece, against 0.02 ms for integers, measured.

| Parameter | Is |
|---|---|
| `logs` | string array, newest first: `NAME SIZE CHANGED_NS` |
| `log/NAME/OFFSET` | a piece of a log |
| `sha256/NAME/SIZE` | string: of the first SIZE bytes of a log; `busy` until it is known |
| `bundle` | string: `none`, `busy`, `failed: WHY`, or `NAME SIZE SHA256` of the newest support bundle |
| `bundle/make` | the same; one is made where none is being made |
| `bundle/NAME/OFFSET` | a piece of it |

What is not there is not set. A log that grows is fetched as long as it was when it was listed.
"""

import array
import contextlib
import os
import re
import stat
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Final, NamedTuple, TypeAlias

from segway_ecc.node.recording.log_name import robot_of_log

MOST_LOGS: Final = 1000
LONGEST_NAME: Final = 200
NODE: Final = "archive"
PIECE_BYTES: Final = 60 * 1024
"""Fits one UDP message of DDS; what else the robot has to send waits for no more than that on a slow network."""
BUSY: Final = "busy"
NONE: Final = "none"
FAILED: Final = "failed: "
LOGS: Final = "logs"
LOG: Final = "log"
SHA256: Final = "sha256"
BUNDLE: Final = "bundle"
MAKE: Final = "bundle/make"
LARGEST: Final = 2**62
_WORD: Final = 8
_NUMBER: Final = re.compile(r"[0-9]{1,19}")
_HASH: Final = re.compile(r"[0-9a-f]{64}")
Value: TypeAlias = str | Sequence[str] | bytes | None
"""Of a parameter; None where it is not set, bytes where it is a piece."""


class LogFile(NamedTuple):
    """A log: its file, size in bytes, and when it was last written, ns since the Unix epoch."""

    name: str
    size: int
    changed_ns: int


def is_plain_name(name: str) -> bool:
    """Whether it can only be a file of a folder, and not a hidden one."""
    return bool(name) and not name.startswith(".") and "/" not in name and "\0" not in name


def is_of_one_of(name: str, robots: Collection[str] | None) -> bool:
    """Whether a log may be one of these robots', or of any for None: its name is not that of another's run."""
    return robots is None or robot_of_log(name) in {None, *robots}


def logs_in(folder: Path, robots: Collection[str] | None = None) -> list[LogFile]:
    """The logs of a folder, newest first: regular files only; links and hidden files are none.

    With the names of `robots` without those of others' runs, see `is_of_one_of`.
    """
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                is_ours = not entry.name.startswith(".") and is_of_one_of(entry.name, robots)
                if is_ours and entry.is_file(follow_symlinks=False):
                    status = entry.stat(follow_symlinks=False)
                    found.append(LogFile(entry.name, status.st_size, status.st_mtime_ns))
    return sorted(found, key=lambda log: (-log.changed_ns, log.name))[:MOST_LOGS]


def open_log(folder: Path, name: str, robots: Collection[str] | None = None) -> tuple[int, int]:
    """A log's file descriptor, which is the caller's to close, and its size in bytes; `robots` as for `logs_in`.

    Raises:
        FileNotFoundError: There is no such log: it is a link, no file, hidden, in another folder, or another robot's.
    """
    if not is_plain_name(name) or not is_of_one_of(name, robots):
        raise FileNotFoundError
    try:
        place = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    except OSError:
        raise FileNotFoundError from None
    try:
        # Neither a link nor a pipe, which would make us wait, is opened.
        file = os.open(name, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC, dir_fd=place)
    except (OSError, ValueError):  # ValueError: a name that no file can have
        raise FileNotFoundError from None
    finally:
        os.close(place)
    status = os.fstat(file)
    if not stat.S_ISREG(status.st_mode):
        os.close(file)
        raise FileNotFoundError
    return file, status.st_size


class FileRequest(NamedTuple):
    """What a parameter's name asks for, where it is about a file.

    Its kind is `log`, `sha256` or `bundle`; the number is where the piece begins, or how much is hashed, bytes.
    """

    kind: str
    name: str
    number: int


class FinishedBundle(NamedTuple):
    """A support bundle that can be fetched: its file, size in bytes, and SHA-256 in hexadecimal digits."""

    name: str
    size: int
    sha256: str


def parameter_name(wanted: FileRequest) -> str:
    """The parameter's name."""
    return f"{wanted.kind}/{wanted.name}/{wanted.number}"


def file_request_of(name: str) -> FileRequest | None:
    """What a parameter's name asks for, or None where it is no such name."""
    kind, _, rest = name.partition("/")
    file, _, number = rest.rpartition("/")
    if kind not in {LOG, SHA256, BUNDLE} or not _is_name(file) or not _is_count(number):
        return None
    return FileRequest(kind, file, int(number))


def words_of(piece: bytes) -> "array.array[int]":
    """A piece as 64-bit integers."""
    words = array.array("q", [len(piece)])
    tail = array.array("q")
    tail.frombytes(piece + bytes(-len(piece) % _WORD))
    words.extend(_little(tail))
    return words


def piece_of(words: Sequence[int]) -> bytes | None:
    """The piece in 64-bit integers; None where they are none, or hold more than a piece."""
    if len(words) == 0 or not 0 <= words[0] <= PIECE_BYTES or len(words) - 1 != -(-words[0] // _WORD):
        return None
    try:
        return _little(array.array("q", words[1:])).tobytes()[: words[0]]
    except OverflowError:
        return None


def listing_of(logs: Sequence[LogFile]) -> list[str]:
    """Logs as lines."""
    return [f"{log.name} {log.size} {log.changed_ns}" for log in logs if _is_name(log.name)]


def logs_of(lines: Sequence[str]) -> list[LogFile]:
    """Lines as logs; what is none is left out."""
    found = []
    for line in lines[:MOST_LOGS]:
        name, size, changed = [*line.rsplit(" ", 2), "", ""][:3]
        if _is_name(name) and _is_count(size) and _is_count(changed):
            found.append(LogFile(name, int(size), int(changed)))
    return found


def finished_bundle_of(text: str) -> FinishedBundle | None:
    """The bundle that a text describes, or None."""
    name, size, sha256 = [*text.rsplit(" ", 2), "", ""][:3]
    if not (_is_name(name) and _is_count(size) and is_sha256(sha256)):
        return None
    return FinishedBundle(name, int(size), sha256)


def is_sha256(text: str) -> bool:
    """Whether a text is a SHA-256 in hexadecimal digits."""
    return _HASH.fullmatch(text) is not None


def _is_name(name: str) -> bool:
    return is_plain_name(name) and name.isprintable() and len(name) <= LONGEST_NAME


def _is_count(text: str) -> bool:
    return _NUMBER.fullmatch(text) is not None and int(text) <= LARGEST


def _little(words: "array.array[int]") -> "array.array[int]":
    """Words of this machine from little-endian ones, or the other way."""
    if sys.byteorder == "big":
        words.byteswap()
    return words
