"""Runs a command in user-mode Linux, whose kernel has SocketCAN with virtual interfaces.

The guest sees the host's files, so the same virtual environment and checkout run inside, but what it writes stays in
its memory: only the results folder is the host's own. Also a command:

    python -m hil.kernels.uml --interface vcan0 --timeout 60 -- python -m pytest tests/kernel/guest
"""

import argparse
import contextlib
import os
import secrets
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from hil.kernels.console import Console

GUEST_ERROR_STATUS = 125
_SYSTEM_PATH = "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_MODULES = Path("/usr/lib/uml/modules")
_NEEDED_MODULES = ("fs/overlayfs/overlay.ko", "net/can/can-raw.ko", "drivers/net/can/vcan.ko")
_PACKAGES = {"linux.uml": "user-mode-linux", "ip": "iproute2", "setpriv": "util-linux"}
_ENDS_WITHIN_S = 2.0


class GuestError(RuntimeError):
    """The guest could not be started, did not finish in time, or ended without saying how the command ended."""


@dataclass(frozen=True)
class GuestResult:
    """How a command in the guest ended.

    Attributes:
        exit_status: The command's own; 128 plus the signal's number where a signal ended it.
        output: What it wrote to standard output and standard error, as one text.
    """

    exit_status: int
    output: str


def _search_path() -> str:
    # Debian keeps ip where the PATH of an ordinary user does not always look.
    return f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"


def available() -> str | None:
    """Tell whether this machine can run a guest.

    Returns:
        None when it can, else one line: what is missing and the Debian command that installs it.
    """
    for program, package in _PACKAGES.items():
        if shutil.which(program, path=_search_path()) is None:
            return f"{program} is not installed: sudo apt-get install {package}"
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
    token = f"guest-{secrets.token_hex(8)}"
    console = Console(token, on_output)
    with tempfile.TemporaryDirectory(prefix="uml-guest-", ignore_cleanup_errors=True) as folder:
        scratch = Path(folder).resolve()
        _write_init(scratch, token, interfaces, results)
        _write_command(scratch, command, cwd, environment or {})
        _boot(scratch, memory_mib, timeout_s, console)
        return GuestResult(_exit_status(scratch, console), "".join(console.output))


def _write_init(scratch: Path, token: str, interfaces: Sequence[str], results: Path | None) -> None:
    if results is not None:
        results.mkdir(parents=True, exist_ok=True)
    settings = {
        "GUEST_SCRATCH": str(scratch),
        "GUEST_RESULTS": "" if results is None else str(results.resolve()),
        "GUEST_INTERFACES": " ".join(interfaces),
        "GUEST_PYTHON": sys.executable,
        "GUEST_TOKEN": token,
    }
    lines = (f"{name}={shlex.quote(value)}\n" for name, value in settings.items())
    (scratch / "job.sh").write_text("".join(lines), encoding="utf-8")
    init = scratch / "init"
    init.write_text(resources.files("hil.kernels").joinpath("guest_init.sh").read_text("utf-8"), encoding="utf-8")
    init.chmod(0o700)


def _write_command(scratch: Path, command: Sequence[str], cwd: Path, environment: Mapping[str, str]) -> None:
    # TERM: the console is a terminal, and colours would only spoil the output that is handed back.
    variables = {
        "PATH": f"{Path(sys.executable).parent}:{_SYSTEM_PATH}",
        "HOME": "/run/home",
        "LANG": "C.UTF-8",
        "TERM": "dumb",
        **environment,
    }
    assignments = [f"{name}={value}" for name, value in variables.items()]
    words = shlex.join(["env", "-i", *assignments, *command])
    text = f"cd {shlex.quote(str(cwd.resolve()))} || exit 126\nexec {words}\n"
    (scratch / "command.sh").write_text(text, encoding="utf-8")


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


def _boot(scratch: Path, memory_mib: int, timeout_s: float, console: Console) -> None:
    # setpriv: the guest must not outlive this process, even one that is killed. TERM, since its kernel then ends its
    # helper processes too.
    kernel = ["setpriv", "--pdeathsig", "TERM", "linux.uml", f"mem={memory_mib}M", f"uml_dir={scratch}/"]
    root = ["root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", f"init={scratch}/init"]
    screen = ["quiet", "loglevel=1", "con=null", "con0=null,fd:1"]
    variables = {"PATH": _search_path(), "HOME": str(scratch), "TMPDIR": str(_memory_folder(memory_mib))}
    with subprocess.Popen(  # noqa: S603 - the arguments are ours, and no shell reads them
        [*kernel, *root, *screen],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=variables,
        start_new_session=True,
    ) as process:
        try:
            finished = console.follow(process.stdout, time.monotonic() + timeout_s)
        finally:
            _end(process)
    if not finished:
        raise GuestError(
            f"The guest was killed after {timeout_s:g} s, unfinished: allow more time{console.last_lines()}"
        )


def _end(process: subprocess.Popen[bytes]) -> None:
    """End every process of the guest, each of which is one of the host's."""
    # Asked to end, the guest's kernel ends and reaps its own; killed, it would leave orphans to the host.
    process.terminate()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(_ENDS_WITHIN_S)
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def _exit_status(scratch: Path, console: Console) -> int:
    try:
        return int((scratch / "status").read_text("ascii"))
    except (FileNotFoundError, ValueError) as error:
        raise GuestError(
            f"The guest ended without the command's exit status: its kernel or its set-up failed{console.last_lines()}"
        ) from error


def _to_stdout(text: str) -> None:
    sys.stdout.write(text)
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Returns:
        The exit status of the command in the guest, or 125 where the guest itself failed.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(prog="python -m hil.kernels.uml", usage="%(prog)s [options] -- COMMAND...")
    parser.add_argument("--interface", action="append", help="a vcan interface to create (default: vcan0)")
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds, boot included (default: %(default)g)")
    parser.add_argument("--results", type=Path, help="a folder that the guest may write")
    split = words.index("--") if "--" in words else len(words)
    (options, unknown), command = parser.parse_known_args(words[:split]), words[split + 1 :]
    if unknown or not command:
        parser.error(f"options, then --, then the command, as in: {parser.prog} -- python -m pytest tests/kernel/guest")
    try:
        result = run_in_guest(
            command,
            cwd=Path.cwd(),
            interfaces=options.interface or ("vcan0",),
            timeout_s=options.timeout,
            on_output=_to_stdout,
            results=options.results,
        )
    except GuestError as error:
        sys.stderr.write(f"{error}\n")
        return GUEST_ERROR_STATUS
    return result.exit_status


if __name__ == "__main__":
    sys.exit(main())
