# SPDX-License-Identifier: MIT
"""Files that are whole or not there, whatever moment the power goes."""

import contextlib
import fcntl
import hashlib
import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Final

_PART: Final = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+!-]{0,199}")
_LOCK: Final = ".lock"


class AgentRefusedError(Exception):
    """The robot does not do what it was asked for; nothing was changed."""


def is_safe(path: str) -> bool:
    """Whether a relative path stays where it is put: plain names, none of them hidden, no way up."""
    parts = PurePosixPath(path).parts
    return bool(parts) and path == "/".join(parts) and all(_PART.fullmatch(part) for part in parts)


def sync_folder(folder: Path) -> None:
    """Have the names in a folder on the disk."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def write_whole(path: Path, content: bytes, mode: int = 0o644) -> None:
    """Put a file in place, durably, so that it is found as it was before, or as it is now.

    It has that mode whatever the umask is, and is never there with another one.
    """
    new = path.with_name(f".{path.name}.{os.getpid()}")
    new.unlink(missing_ok=True)
    descriptor = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, mode)
    with os.fdopen(descriptor, "wb") as file:
        os.fchmod(descriptor, mode)
        file.write(content)
        file.flush()
        os.fsync(descriptor)
    new.replace(path)
    sync_folder(path.parent)


def link_whole(path: Path, target: str) -> None:
    """Put a symbolic link in place of whatever link or file is there, in one step."""
    new = path.with_name(f".{path.name}.new")
    new.unlink(missing_ok=True)
    new.symlink_to(target)
    new.replace(path)
    sync_folder(path.parent)


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, as hexadecimal digits."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@contextlib.contextmanager
def locked(root: Path) -> Iterator[None]:
    """Be the only one who changes releases.

    A child that is forked meanwhile holds the lock too, until it ends.

    Raises:
        AgentRefusedError: Somebody else is.
    """
    descriptor = os.open(root / _LOCK, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise AgentRefusedError("another update is under way; see: segway-ecc deploy status") from None
        yield
    finally:
        os.close(descriptor)


def is_locked(root: Path) -> bool:
    """Whether somebody changes releases now."""
    try:
        descriptor = os.open(root / _LOCK, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    finally:
        os.close(descriptor)
    return False
