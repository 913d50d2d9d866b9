# SPDX-License-Identifier: MIT
"""A machine that boots an image of the robot: user-mode Linux, with a root shell on one of its consoles."""

import contextlib
import os
import pty
import re
import secrets
import select
import signal
import subprocess
import termios
import time
from collections.abc import Iterator
from pathlib import Path

from segway_ecc.hil.kernels.guest import GuestError, search_path
from segway_ecc.hil.kernels.uml import register_variables

_MARK = "guest-mark"


class MachineError(GuestError):
    """The machine did not do in time what was requested; with the end of its console."""


class Machine:
    """A running machine.

    The messages of the kernel and the services are in the file `console`; the shell is systemd's debug
    shell, so that the image is as it is shipped.

    Attributes:
        console: The messages of the machine.
        share: A folder of the host's that the machine has as /run/share.
        began: When it was switched on, `time.monotonic()`.
    """

    def __init__(self, root: Path, data: Path, folder: Path, *options: str, memory_mib: int = 768) -> None:
        """Switch it on: a root file system that is only read, and a data partition that is written.

        Args:
            root: The root file system.
            data: The data partition.
            folder: Where the console is written, and what is shared.
            *options: More words of the kernel's command line.
            memory_mib: Its memory, MiB.
        """
        folder.mkdir(parents=True, exist_ok=True)
        self.console = folder / "console"
        self.share = folder / "share"
        self.share.mkdir(exist_ok=True)
        self._shell, end = pty.openpty()
        settings = termios.tcgetattr(end)
        settings[1] &= ~termios.OPOST
        settings[3] &= ~termios.ECHO
        termios.tcsetattr(end, termios.TCSANOW, settings)
        words = [
            *("taskset", "-c", str(_one_processor()), "setpriv", "--pdeathsig", "TERM"),
            *("linux.uml", f"mem={memory_mib}M", f"uml_dir={folder}/"),
            *(f"ubd0r={root}", f"ubd1={data}", "root=/dev/ubda", "rootfstype=ext4", "ro"),
            *("init=/usr/lib/segway-ecc/init", "segway.data=/dev/ubdb", "systemd.debug-shell=1"),
            *("con=null", "con0=null,fd:1", f"con9=tty:{os.ttyname(end)}", "noreboot"),
            *options,
        ]
        self.began = time.monotonic()
        with self.console.open("wb") as console:
            self._process = subprocess.Popen(
                words,
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=subprocess.STDOUT,
                env={
                    "PATH": search_path(),
                    "HOME": str(folder),
                    "TMPDIR": "/dev/shm",  # noqa: S108 - the kernel maps its memory executable
                    **register_variables(),
                },
                start_new_session=True,
            )
        self._end = end
        self._received = ""

    def wait_for_shell(self, timeout_s: float = 120.0) -> None:
        """Wait until the shell answers, and share a folder with it as /run/share."""
        deadline = time.monotonic() + timeout_s
        while time.monotonic() < deadline:
            with contextlib.suppress(MachineError):
                self.run("true", 2.0)
                os.write(self._shell, b"export TERM=dumb; exec sh\n")  # not bash, which plays with its line
                self.run("stty -echo -onlcr; PS1=; PS2=")
                self.run(f"mkdir -p /run/share && mount -t hostfs -o {self.share} none /run/share")
                return
        raise self._error("no shell")

    def run(self, command: str, timeout_s: float = 60.0) -> str:
        """Run a command in the shell; returns its output. A status other than zero is an error."""
        mark = f"{_MARK}-{secrets.token_hex(4)}"
        # Cut in two, so that an echo of the command is not taken for its end.
        os.write(self._shell, f"{command}\necho {mark[:6]}''{mark[6:]} $?\n".encode())
        answer = self._read_until(re.compile(rf"{mark} (\d+)\r?\n"), timeout_s)
        if answer is None:
            raise self._error(f"no answer to: {command}")
        text, status = answer
        if status != "0":
            raise self._error(f"status {status} of: {command}\n{text}")
        return text.replace("\r", "")

    def wait_until(self, command: str, timeout_s: float) -> float:
        """Wait until a command succeeds, and return how long that took, s."""
        began = time.monotonic()
        while True:
            try:
                self.run(f"{command} > /dev/null")
            except MachineError:
                if time.monotonic() - began > timeout_s:
                    raise
                time.sleep(0.1)
            else:
                return time.monotonic() - began

    def property(self, name: str, unit: str = "segway-ecc-node.service") -> str:
        """A property of a unit."""
        return self.run(f"systemctl show -P {name} {unit}").strip()

    def cut(self) -> None:
        """Take its power away: what is not on its disk is lost."""
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        for end in (self._shell, self._end):
            with contextlib.suppress(OSError):
                os.close(end)

    def _read_until(self, mark: re.Pattern[str], timeout_s: float) -> tuple[str, str] | None:
        deadline = time.monotonic() + timeout_s
        while True:
            found = mark.search(self._received)
            if found is not None:
                text, self._received = self._received[: found.start()], self._received[found.end() :]
                return text, found.group(1)
            left = deadline - time.monotonic()
            if left <= 0 or self._process.poll() is not None:
                return None
            if select.select([self._shell], [], [], min(left, 0.5))[0]:
                self._received += os.read(self._shell, 65536).decode(errors="replace")

    def _error(self, what: str) -> MachineError:
        lines = self.console.read_text(errors="replace").splitlines()[-30:]
        return MachineError(f"{what}; shell: {self._received[-500:]!r}; the console's last lines:\n" + "\n".join(lines))


def _one_processor() -> int:
    """The processor that a machine runs on.

    User-mode Linux is one processor, whose kernel and programs are processes of the host's that take turns at each page
    fault and system call. Where they are on two, each turn has to wake the other up, and all takes thrice as long.
    """
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[os.getpid() % len(allowed)]  # machines of several test processes are not all on the same one


@contextlib.contextmanager
def switched_on(root: Path, data: Path, folder: Path, *options: str) -> Iterator[Machine]:
    """A machine whose shell answers; its power is cut at the end. See `Machine` for the arguments."""
    machine = Machine(root, data, folder, *options)
    try:
        machine.wait_for_shell()
        yield machine
    finally:
        machine.cut()
