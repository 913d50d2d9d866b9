# SPDX-License-Identifier: MIT
"""What user-mode Linux 6.1 needs to run on a processor with more register state than it has room for."""

import subprocess
from importlib import resources
from pathlib import Path
from typing import Final

from segway_ecc.hil.kernels.guest import GuestError
from segway_ecc.node.native.cache import cached, digest

_CPU: Final = Path("/proc/cpuinfo")
_LARGE_STATE: Final = "amx_tile"
_NAME: Final = "uml_registers"


def register_variables() -> dict[str, str]:
    """The environment variables with which the guest's kernel runs on this processor; none on most.

    Raises:
        GuestError: This processor needs a library that cannot be compiled here.
    """
    if _LARGE_STATE not in _CPU.read_text(encoding="ascii", errors="replace").split():
        return {}
    source = resources.files("segway_ecc.hil.kernels").joinpath(f"{_NAME}.c").read_bytes()
    return {"LD_PRELOAD": str(cached(digest(_NAME, source), lambda folder: _compile(source, folder)) / f"{_NAME}.so")}


def _compile(source: bytes, folder: Path) -> None:
    words = ["gcc", "-O2", "-shared", "-fPIC", "-x", "c", "-", "-o", str(folder / f"{_NAME}.so")]
    try:
        subprocess.run(words, input=source, check=True, capture_output=True)  # noqa: S603 - our own words
    except (OSError, subprocess.CalledProcessError) as error:
        raise GuestError(
            f"user-mode Linux runs on this processor ({_LARGE_STATE}) only with a library that gcc has to compile, "
            f"which failed: {error}; sudo apt-get install gcc libc6-dev"
        ) from error
