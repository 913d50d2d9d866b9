# SPDX-License-Identifier: MIT
"""A folder of logs: regular files only, by name, and nothing beyond it whatever name is asked for."""

import contextlib
import os
import stat
from pathlib import Path
from typing import Final, NamedTuple

MOST_LOGS: Final = 1000
LONGEST_NAME: Final = 200


class LogFile(NamedTuple):
    """A log.

    Attributes:
        name: Of the file.
        size: Bytes.
        changed_ns: When it was last written, ns since the Unix epoch.
    """

    name: str
    size: int
    changed_ns: int


def is_plain_name(name: str) -> bool:
    """Whether it can only be a file of a folder, and not a hidden one."""
    return bool(name) and not name.startswith(".") and "/" not in name and "\0" not in name


def logs_in(folder: Path) -> list[LogFile]:
    """The logs, newest first; links and hidden files are none."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                if not entry.name.startswith(".") and entry.is_file(follow_symlinks=False):
                    status = entry.stat(follow_symlinks=False)
                    found.append(LogFile(entry.name, status.st_size, status.st_mtime_ns))
    return sorted(found, key=lambda log: (-log.changed_ns, log.name))[:MOST_LOGS]


def open_log(folder: Path, name: str) -> tuple[int, int]:
    """A log's file descriptor, which is the caller's to close, and its size in bytes.

    Raises:
        FileNotFoundError: There is no such log: it is a link, no file, hidden, or in another folder.
    """
    if not is_plain_name(name):
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
