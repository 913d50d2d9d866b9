# SPDX-License-Identifier: MIT
"""The files this process has open, by name: one of another test may be closed meanwhile, and its number given away."""

from pathlib import Path


def open_files() -> set[str]:
    found = set()
    for link in Path("/proc/self/fd").iterdir():
        try:
            found.add(str(link.readlink()))
        except FileNotFoundError:  # the one that lists, or one that was closed meanwhile
            continue
    return found
