# SPDX-License-Identifier: MIT
"""What the guests have in common: the task that one is given, its console, and how its command ended."""

import argparse
import codecs
import contextlib
import os
import re
import resource
import secrets
import selectors
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import IO, Required, TypedDict

# A kernel that panics writes why first, and then some fifty lines.
_LINES_IN_ERROR = 60
_PANIC = re.compile(r"\[ *\d+\.\d+\] Kernel panic - not syncing")
_PANIC_TAKES_S = 5.0
GUEST_ERROR_STATUS = 125
_SYSTEM_PATH = "/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
_ENDS_WITHIN_S = 2.0


class Console:
    """Splits the guest's console by the marks that its first process writes around the command's output.

    That is kept in `output`, in pieces of at most a line.
    """

    def __init__(self, token: str, on_output: Callable[[str], None] | None, clock: Callable[[], float]) -> None:
        self.output: list[str] = []
        self._tail: deque[str] = deque(maxlen=_LINES_IN_ERROR)
        self._begin, self._end = f"{token} begin", f"{token} end"
        self._on_output = on_output
        self._clock = clock
        self._in_command = False
        self._partial = ""
        self._panicked_s: float | None = None

    def follow(self, stream: IO[bytes] | None, timeout_s: float) -> bool:
        """Read the console until the guest has ended, True, or for so long, False.

        It has ended when it closes the console, and some seconds after its kernel panicked: stopping its other
        processors, such a kernel can come to wait for a lock that one of them held, and never end.
        """
        decoder = codecs.getincrementaldecoder("utf-8")("replace")
        closed = stream is None
        deadline = self._clock() + timeout_s
        with selectors.DefaultSelector() as selector:
            if stream is not None:
                selector.register(stream, selectors.EVENT_READ)
            while not closed and (left := deadline - self._clock()) > 0:
                for key, _ in selector.select(left):
                    chunk = os.read(key.fd, 65536)
                    *lines, self._partial = (self._partial + decoder.decode(chunk)).split("\n")
                    for line in lines:
                        # The guest's terminal ends each line with a carriage return too.
                        self._add_line(line.removesuffix("\r") + "\n")
                    closed = not chunk
                if self._panicked_s is not None:
                    deadline = min(deadline, self._panicked_s + _PANIC_TAKES_S)
        if self._partial:
            self._add_line(self._partial)
        return closed or self._panicked_s is not None

    def last_lines(self) -> str:
        """Return the end of an error message: the last lines of the kernel and the command together."""
        return "; the console's last lines:" + "".join(f"\n  {line}" for line in self._tail)

    def _add_line(self, line: str) -> None:
        if self._begin in line:
            self._in_command = True
            return
        if self._panicked_s is None and _PANIC.search(line):
            self._panicked_s = self._clock()
        # The mark follows the end of the command's output on the same line where they did not end with a newline.
        text, mark, _ = line.partition(self._end)
        if text.strip():
            self._tail.append(text.rstrip())
        if self._in_command and text:
            self.output.append(text)
            if self._on_output is not None:
                self._on_output(text)
        self._in_command = self._in_command and not mark


class GuestError(RuntimeError):
    """The guest could not be started, did not finish in time, or ended without the command's exit status."""


@dataclass(frozen=True)
class GuestResult:
    """How a command in the guest ended: with its own exit status, or 128 plus the number of the signal that ended it.

    The output is what it wrote to standard output and standard error, as one text.
    """

    exit_status: int
    output: str


class GuestOptions(TypedDict, total=False):
    """How a command is run in a guest; what is left out has the default.

    Attributes:
        cwd: The folder to run it in, not below /run, /dev, /proc or /sys, which are the guest's own.
        environment: Added to the guest's PATH, HOME, LANG and TERM. Nothing else comes from the host's environment.
        memory_mib: The guest's memory; half of it holds the files it writes.
        timeout_s: Everything, boot included, is killed after this long; by default 300 s.
        on_output: Called with each line of the command's output as it comes.
        results: A host folder, made if missing, that the guest can write, at the same path.
        clock: What `timeout_s` is measured with; seconds, monotonic; by default the host's.
    """

    cwd: Required[Path]
    environment: Mapping[str, str]
    memory_mib: int
    timeout_s: float
    on_output: Callable[[str], None]
    results: Path | None
    clock: Callable[[], float]


@dataclass(frozen=True)
class GuestTask:
    """What a guest is to run, and the folder of the host through which it gets it.

    Attributes:
        scratch: The guest's first process finds here `settings.sh`, shell variables; `guest.sh`, what the guests
            share; and `command.sh`, what to run. It writes the command's exit status to `status`.
        results: The host folder that the guest can write, or None.
        console: Where the guest's console is read.
        timeout_s: The guest is killed after this long.
    """

    scratch: Path
    results: Path | None
    console: Console
    timeout_s: float


def search_path() -> str:
    """Return the PATH to look for programs in: Debian keeps ip where that of an ordinary user does not always look."""
    return f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"


def missing_programs(packages: Mapping[str, str]) -> list[str]:
    """Return those of the programs, each named with its Debian package, that this machine lacks."""
    return [program for program in packages if shutil.which(program, path=search_path()) is None]


@contextlib.contextmanager
def prepared_task(command: Sequence[str], settings: Mapping[str, str], options: GuestOptions) -> Iterator[GuestTask]:
    """Write a task, a program and its arguments, to a folder of its own, which goes when the guest has ended.

    `settings` are shell variables for the guest's first process, besides the common ones.
    """
    token, results = f"guest-{secrets.token_hex(8)}", options.get("results")
    if results is not None:
        results.mkdir(parents=True, exist_ok=True)
        results = results.resolve()
    # TERM: the console is a terminal, and colours would only spoil the output that is handed back.
    variables = {
        "PATH": f"{Path(sys.executable).parent}:{_SYSTEM_PATH}",
        "HOME": "/run/home",
        "LANG": "C.UTF-8",
        "TERM": "dumb",
        **options.get("environment", {}),
    }
    words = shlex.join(["env", "-i", *(f"{name}={value}" for name, value in variables.items()), *command])
    with tempfile.TemporaryDirectory(prefix="guest-", ignore_cleanup_errors=True) as folder:
        scratch = Path(folder).resolve()
        common = {"GUEST_TOKEN": token, "GUEST_SCRATCH": str(scratch), "GUEST_RESULTS": str(results or "")}
        lines = (f"{name}={shlex.quote(value)}\n" for name, value in {**common, **settings}.items())
        (scratch / "settings.sh").write_text("".join(lines), encoding="utf-8")
        (scratch / "guest.sh").write_text(script("guest.sh"), encoding="utf-8")
        text = f"cd {shlex.quote(str(options['cwd'].resolve()))} || exit 126\nexec {words}\n"
        (scratch / "command.sh").write_text(text, encoding="utf-8")
        console = Console(token, options.get("on_output"), options.get("clock", time.monotonic))
        yield GuestTask(scratch, results, console, options.get("timeout_s", 300.0))


def script(name: str) -> str:
    """Return a shell script that stands beside this module."""
    return resources.files("segway_ecc.hil.kernels").joinpath(name).read_text("utf-8")


def run_task(task: GuestTask, kernel: Sequence[str], variables: Mapping[str, str]) -> GuestResult:
    """Run the program that is the guest's kernel, or emulates its machine, until the guest has switched itself off.

    Args:
        task: What the guest finds in its scratch folder.
        kernel: The program and its arguments. Its standard output is the guest's console.
        variables: The program's environment.

    Raises:
        GuestError: The guest ran out of time, or ended without an exit status.
    """
    # setpriv: the guest must not outlive this process, even one that is killed. TERM, since a kernel in user mode
    # then ends its helper processes too. prlimit: in user mode it keeps each file open that the guest has looked at,
    # and users have 1,024 unless they ask for more.
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    words = ["setpriv", "--pdeathsig", "TERM", "prlimit", f"--nofile={most}:{most}", *kernel]
    with subprocess.Popen(  # noqa: S603 - the arguments are ours, and no shell reads them
        words,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=variables,
        start_new_session=True,
    ) as process:
        try:
            finished = task.console.follow(process.stdout, task.timeout_s)
        finally:
            # Each process of the guest is one of the host's. Asked to end, the guest's kernel ends and reaps its own;
            # killed, it would leave orphans to the host.
            process.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_ENDS_WITHIN_S)
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
    last_lines = task.console.last_lines()
    if not finished:
        raise GuestError(f"The guest was killed after {task.timeout_s:g} s, unfinished: allow more time{last_lines}")
    try:
        status = int((task.scratch / "status").read_text("ascii"))
    except (FileNotFoundError, ValueError) as error:
        raise GuestError(
            f"The guest ended without the command's exit status: its kernel or its set-up failed{last_lines}"
        ) from error
    return GuestResult(status, "".join(task.console.output))


def command_line(
    parser: argparse.ArgumentParser,
    arguments: Sequence[str] | None,
    run: Callable[[argparse.Namespace, Sequence[str], GuestOptions], GuestResult],
) -> int:
    """Run the command line of a kind of guest; returns the command's exit status, or 125 where the guest itself failed.

    The parser knows the options of that kind; those that all kinds have are added here. `run` runs the command, the
    words after --, with these options; without arguments they are those of this process.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser.usage = "%(prog)s [options] -- COMMAND..."
    parser.add_argument("--timeout", type=float, default=300.0, help="seconds, boot included (default: %(default)g)")
    parser.add_argument("--results", type=Path, help="a folder that the guest may write")
    split = words.index("--") if "--" in words else len(words)
    (options, unknown), command = parser.parse_known_args(words[:split]), words[split + 1 :]
    if unknown or not command:
        parser.error(f"options, then --, then the command, as in: {parser.prog} -- python -m pytest tests/kernel/guest")
    try:
        common = GuestOptions(cwd=Path.cwd(), timeout_s=options.timeout, on_output=to_stdout, results=options.results)
        return run(options, command, common).exit_status
    except GuestError as error:
        sys.stderr.write(f"{error}\n")
        return GUEST_ERROR_STATUS


def to_stdout(text: str) -> None:
    """Write the command's output as it comes."""
    sys.stdout.write(text)
    sys.stdout.flush()
