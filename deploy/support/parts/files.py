# SPDX-License-Identifier: MIT
"""The robot file, the newest logs, and a station's audit log."""

import functools
from pathlib import Path
from typing import Final

from segway_ecc.deploy.support.bundle import Collected, Content, Stored
from segway_ecc.deploy.support.log_folder import LogFile, logs_in, open_log

_AUDIT: Final = "audit*.jsonl"
_LARGEST_AUDIT: Final = 16 * 1024 * 1024
_MIB: Final = 1024 * 1024


def robot_file(text: str) -> Collected:
    """The robot file as used."""
    return Collected({"robot.yaml": text})


def newest_logs(folder: Path, count: int, most_bytes: int) -> Collected:
    """The newest logs of a folder, as many as fit.

    Args:
        folder: Where they lie.
        count: At most so many.
        most_bytes: At most so much, together; what does not fit is named.
    """
    files: dict[str, Content] = {}
    missing, left = [], most_bytes
    logs = logs_in(folder)
    for log in logs[:count]:
        if log.size > left:
            size, rest = log.size / _MIB, left / _MIB
            missing.append(f"{log.name}: {size:.1f} MiB are more than the {rest:.1f} MiB that are left")
            continue
        left -= log.size
        files[f"logs/{log.name}"] = Stored(functools.partial(_descriptor, folder, log), log.size)
    if not logs and count:
        missing.append(f"there is no log in {folder}")
    return Collected(files, missing)


def audit_log(folder: Path) -> Collected:
    """A station's audit log, the newest part of it; never its tokens, nor their hashes."""
    files: dict[str, Content] = {}
    missing, left = [], _LARGEST_AUDIT
    for path in sorted(folder.glob(_AUDIT), key=lambda each: (len(each.name), each.name)):
        if path.is_symlink() or not path.is_file():
            continue
        text = path.read_text("utf-8", "replace")
        if len(text) > left:
            missing.append(f"{path.name}: more than {_LARGEST_AUDIT // _MIB} MiB together")
            continue
        left -= len(text)
        files[f"audit/{path.name}"] = text
    if not files and not missing:
        missing.append(f"there is no audit log in {folder}")
    return Collected(files, missing)


def _descriptor(folder: Path, log: LogFile) -> int:
    return open_log(folder, log.name)[0]
