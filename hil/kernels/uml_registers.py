# SPDX-License-Identifier: MIT
"""What user-mode Linux 6.1 needs to run on a processor with more register state than it has room for."""

from importlib import resources
from pathlib import Path
from typing import Final

from segway_ecc.hil.kernels.guest import GuestError
from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import cached, compile_c, digest

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
    words = ["-O2", "-shared", "-fPIC", "-x", "c", "-", "-o", str(folder / f"{_NAME}.so")]
    try:
        compile_c(words, f"{_NAME}.c", source)
    except ModelError as error:
        raise GuestError(
            f"user-mode Linux runs on this processor ({_LARGE_STATE}) only with a library that gcc has to compile, "
            f"which failed: {error}; sudo apt-get install gcc libc6-dev"
        ) from error
