# SPDX-License-Identifier: MIT
"""Runs a command in user-mode Linux, whose kernel has SocketCAN with virtual interfaces.

The guest sees the host's files, so the same virtual environment and checkout run inside, but what it writes stays in
its memory: only the results folder is the host's own. Also a command:

    python -P -m segway_ecc.hil.kernels.uml --interface vcan0 --timeout 60 -- python -m pytest tests/kernel/guest
"""

import argparse
import contextlib
import os
import sys
import tempfile
from collections.abc import Sequence
from importlib import resources
from pathlib import Path
from typing import Final, Unpack

from segway_ecc.hil.kernels.guest import (
    GuestError,
    GuestOptions,
    GuestResult,
    command_line,
    missing_programs,
    prepared_task,
    run_task,
    script,
    search_path,
)
from segway_ecc.node.errors import ModelError
from segway_ecc.node.native.compile import cached, compile_c, digest

_CPU: Final = Path("/proc/cpuinfo")
_LARGE_STATE: Final = "amx_tile"
_REGISTERS: Final = "uml_registers"
_MODULES = Path("/usr/lib/uml/modules")
_NEEDED_MODULES = ("fs/overlayfs/overlay.ko", "net/can/can-raw.ko", "drivers/net/can/vcan.ko")
_PACKAGES = {"linux.uml": "user-mode-linux", "ip": "iproute2", "setpriv": "util-linux"}


def register_variables() -> dict[str, str]:
    """The environment variables with which the guest's kernel runs on this processor; none on most.

    Linux 6.1 in user mode has no room for the register state of some.

    Raises:
        GuestError: This processor needs a library that cannot be compiled here.
    """
    if _LARGE_STATE not in _CPU.read_text(encoding="ascii", errors="replace").split():
        return {}
    source = resources.files("segway_ecc.hil.kernels").joinpath(f"{_REGISTERS}.c").read_bytes()
    folder = cached(digest(_REGISTERS, source), lambda folder: _compile(source, folder))
    return {"LD_PRELOAD": str(folder / f"{_REGISTERS}.so")}


def _compile(source: bytes, folder: Path) -> None:
    words = ["-O2", "-shared", "-fPIC", "-x", "c", "-", "-o", str(folder / f"{_REGISTERS}.so")]
    try:
        compile_c(words, f"{_REGISTERS}.c", source)
    except ModelError as error:
        raise GuestError(
            f"user-mode Linux runs on this processor ({_LARGE_STATE}) only with a library that gcc has to compile, "
            f"which failed: {error}; sudo apt-get install gcc libc6-dev"
        ) from error


def available() -> str | None:
    """Check whether this machine can run a guest: None when it can, else what is missing and how to install it."""
    for program in missing_programs(_PACKAGES):
        return f"{program} is not installed: sudo apt-get install {_PACKAGES[program]}"
    for module in _NEEDED_MODULES:
        if not any(_MODULES.glob(f"*/kernel/{module}")):
            return f"{_MODULES}/*/kernel/{module} is missing: sudo apt-get install --reinstall user-mode-linux"
    return None


def run_in_guest(
    command: Sequence[str], *, interfaces: Sequence[str] = ("vcan0",), **options: Unpack[GuestOptions]
) -> GuestResult:
    """Boot a guest, run one command in it as root, and shut it down.

    Args:
        command: The program and its arguments. This interpreter's folder comes first in the guest's PATH.
        interfaces: The vcan interfaces to create.
        **options: How it is run; the memory is 1024 MiB by default.

    Returns:
        The command's exit status and output.

    Raises:
        GuestError: The guest cannot run here, ran out of time, or ended without an exit status.
    """
    missing = available()
    if missing is not None:
        raise GuestError(f"No guest can run here: {missing}")
    settings = {"GUEST_INTERFACES": " ".join(interfaces), "GUEST_PYTHON": sys.executable}
    memory_mib = options.get("memory_mib", 1024)
    with prepared_task(command, settings, options) as task:
        init = task.scratch / "init"
        init.write_text(script("uml_init.sh"), encoding="utf-8")
        init.chmod(0o700)
        root = ["root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", f"init={init}"]
        screen = ["quiet", "loglevel=1", "con=null", "con0=null,fd:1"]
        kernel = ["linux.uml", f"mem={memory_mib}M", f"uml_dir={task.scratch}/", *root, *screen]
        variables = {
            "PATH": search_path(),
            "HOME": str(task.scratch),
            "TMPDIR": str(_memory_folder(memory_mib)),
            **register_variables(),
        }
        return run_task(task, kernel, variables)


def _memory_folder(memory_mib: int) -> Path:
    """Find room for the file that is the guest's memory, which user-mode Linux maps executable."""
    folders = [Path("/dev/shm"), Path(tempfile.gettempdir())]  # noqa: S108 - named to measure it, no file is made
    for folder in folders:
        with contextlib.suppress(FileNotFoundError):
            room = os.statvfs(folder)
            if room.f_bavail * room.f_frsize >= memory_mib << 20 and not room.f_flag & os.ST_NOEXEC:
                return folder
    raise GuestError(
        f"The guest's memory of {memory_mib} MiB fits neither {folders[0]} nor {folders[1]} (too little free space, "
        "or mounted noexec): set TMPDIR to a folder with room, or ask for less memory"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the command's exit status, or 125 where the guest itself failed."""
    parser = argparse.ArgumentParser(prog="python -P -m segway_ecc.hil.kernels.uml")
    parser.add_argument("--interface", action="append", help="a vcan interface to create (default: vcan0)")
    return command_line(
        parser,
        arguments,
        lambda options, command, common: run_in_guest(command, interfaces=options.interface or ("vcan0",), **common),
    )


if __name__ == "__main__":
    sys.exit(main())
