# SPDX-License-Identifier: MIT
"""Programs that the builder runs, and the error where one fails."""

import os
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import NodeError

PROGRAMS: Final = {
    "mmdebstrap": "mmdebstrap",
    "mke2fs": "e2fsprogs",
    "unshare": "util-linux",
    "chroot": "coreutils",
    "tar": "tar",
}
_PATH: Final = "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_LINES: Final = 8


class ImageError(NodeError):
    """The image cannot be built."""


def missing() -> str | None:
    """What this machine lacks to build images, with the command that installs it; None where it lacks nothing."""
    lacking = sorted({package for program, package in PROGRAMS.items() if shutil.which(program, path=_PATH) is None})
    return f"not installed: sudo apt-get install {' '.join(lacking)}" if lacking else None


def run(words: Sequence[str], *, env: Mapping[str, str] | None = None, cwd: Path | None = None) -> str:
    """Run a program to its end; returns its standard output.

    Raises:
        ImageError: It failed; with its last lines.
    """
    variables = {"PATH": _PATH, "HOME": os.environ.get("HOME", "/"), "LC_ALL": "C.UTF-8", **(env or {})}
    done = subprocess.run(  # noqa: S603 - the words are ours, and no shell reads them
        list(words), env=variables, cwd=cwd, capture_output=True, text=True, errors="replace", check=False
    )
    if done.returncode:
        last = "\n  ".join((done.stderr or done.stdout).strip().splitlines()[-_LINES:])
        raise ImageError(f"{words[0]} failed with status {done.returncode}:\n  {last}")
    return done.stdout


def inside(root: Path, words: Sequence[str], env: Mapping[str, str] | None = None) -> str:
    """Run a program of the image in the image."""
    return run(["chroot", str(root), *words], env=env)
