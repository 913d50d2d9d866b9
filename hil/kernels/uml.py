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
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from segway_ecc.hil.kernels.guest import (
    GuestError,
    GuestResult,
    command_line,
    missing_programs,
    prepared_task,
    run_task,
    script,
    search_path,
    to_stdout,
)
from segway_ecc.hil.kernels.uml_registers import register_variables

__all__ = ["GuestError", "GuestResult", "available", "main", "run_in_guest"]

_MODULES = Path("/usr/lib/uml/modules")
_NEEDED_MODULES = ("fs/overlayfs/overlay.ko", "net/can/can-raw.ko", "drivers/net/can/vcan.ko")
_PACKAGES = {"linux.uml": "user-mode-linux", "ip": "iproute2", "setpriv": "util-linux"}


def available() -> str | None:
    """Tell whether this machine can run a guest.

    Returns:
        None when it can, else one line: what is missing and the Debian command that installs it.
    """
    for program in missing_programs(_PACKAGES):
        return f"{program} is not installed: sudo apt-get install {_PACKAGES[program]}"
    for module in _NEEDED_MODULES:
        if not any(_MODULES.glob(f"*/kernel/{module}")):
            return f"{_MODULES}/*/kernel/{module} is missing: sudo apt-get install --reinstall user-mode-linux"
    return None


def run_in_guest(  # noqa: PLR0913 - all but the command are named at the call and have defaults
    command: Sequence[str],
    *,
    cwd: Path,
    interfaces: Sequence[str] = ("vcan0",),
    environment: Mapping[str, str] | None = None,
    memory_mib: int = 1024,
    timeout_s: float = 300.0,
    on_output: Callable[[str], None] | None = None,
    results: Path | None = None,
) -> GuestResult:
    """Boot a guest, run one command in it as root, and shut it down.

    Args:
        command: The program and its arguments. This interpreter's folder comes first in the guest's PATH.
        cwd: The folder to run it in, not below /run, /dev, /proc or /sys, which are the guest's own.
        interfaces: The vcan interfaces to create.
        environment: Added to the guest's PATH, HOME, LANG and TERM. Nothing else comes from the host's environment.
        memory_mib: The guest's memory; half of it holds the files it writes.
        timeout_s: Everything, boot included, is killed after this long.
        on_output: Called with each line of the command's output as it comes.
        results: A host folder, made if missing, that the guest can write, at the same path.

    Returns:
        The command's exit status and output.

    Raises:
        GuestError: The guest cannot run here, ran out of time, or ended without an exit status.
    """
    missing = available()
    if missing is not None:
        raise GuestError(f"No guest can run here: {missing}")
    settings = {"GUEST_INTERFACES": " ".join(interfaces), "GUEST_PYTHON": sys.executable}
    prepared = prepared_task(
        command, cwd, environment=environment, on_output=on_output, results=results, settings=settings
    )
    with prepared as job:
        init = job.scratch / "init"
        init.write_text(script("uml_init.sh"), encoding="utf-8")
        init.chmod(0o700)
        variables = {
            "PATH": search_path(),
            "HOME": str(job.scratch),
            "TMPDIR": str(_memory_folder(memory_mib)),
            **register_variables(),
        }
        return run_task(job, _kernel(job.scratch, memory_mib), variables, timeout_s)


def _kernel(scratch: Path, memory_mib: int) -> list[str]:
    root = ["root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", f"init={scratch}/init"]
    screen = ["quiet", "loglevel=1", "con=null", "con0=null,fd:1"]
    return ["linux.uml", f"mem={memory_mib}M", f"uml_dir={scratch}/", *root, *screen]


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
    """Run the command line.

    Returns:
        The exit status of the command in the guest, or 125 where the guest itself failed.
    """
    parser = argparse.ArgumentParser(prog="python -P -m segway_ecc.hil.kernels.uml")
    parser.add_argument("--interface", action="append", help="a vcan interface to create (default: vcan0)")
    return command_line(parser, arguments, _run)


def _run(options: argparse.Namespace, command: Sequence[str]) -> GuestResult:
    return run_in_guest(
        command,
        cwd=Path.cwd(),
        interfaces=options.interface or ("vcan0",),
        timeout_s=options.timeout,
        on_output=to_stdout,
        results=options.results,
    )


if __name__ == "__main__":
    sys.exit(main())
