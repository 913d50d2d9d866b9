# SPDX-License-Identifier: MIT
"""The way to a robot: the system's own ssh, so that the user's configuration, keys and jump hosts hold.

The robot's side is sent with each request, as one file that its `python3` runs, and kept there for the next boot.
"""

import contextlib
import importlib.resources
import io
import json
import shlex
import subprocess
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from segway_ecc.node.errors import ConfigurationError, NobodyListensError, NodeError, RobotLostError

_PACKAGES: Final = ("segway_ecc", "segway_ecc.deploy", "segway_ecc.deploy.release", "segway_ecc.deploy.release.agent")
_MAIN: Final = """import sys

from segway_ecc.deploy.release.agent.main import main

sys.exit(main(sys.argv[1:]))
"""
_LONG_AGO: Final = (2020, 2, 2, 0, 0, 0)
# Also an old python3 must be able to read this, to report its age. The program stays in memory and leaves nothing.
BOOTSTRAP: Final = """
import sys
if sys.version_info < (3, 11):
    sys.stderr.write("its python3 is %d.%d, and 3.11 or later is needed\\n" % sys.version_info[:2])
    sys.exit(11)
import os
source = sys.stdin.buffer
agent = source.read(int(source.readline()))
place = os.memfd_create("agent")
with open(place, "wb", closefd=False) as file:
    file.write(agent)
sys.path.insert(0, "/proc/self/fd/%d" % place)
from segway_ecc.deploy.release.agent.main import serve
from segway_ecc.deploy.release.agent.journal import Reporter
sys.exit(serve(agent, source, Reporter(sys.stdout.buffer)))
"""
ROOT: Final = "/opt/segway-ecc"
ROBOT_CONFIG: Final = "/etc/segway-ecc"
Event = Mapping[str, Any]
_NO_CONNECTION: Final = 255
_NO_COMMAND: Final = 127
_CHUNK: Final = 2**18
# A small computer that installs may not get round to an answer for half a minute.
_OPTIONS: Final = ("-T", "-o", "ServerAliveInterval=10", "-o", "ServerAliveCountMax=6", "-o", "ControlMaster=auto")


class UpdateRefusedError(NodeError):
    """The robot does not do what it was asked for, and runs what it ran before."""

    exit_code = 11


class UpdateFailedError(NodeError):
    """The release was not healthy; the text names what the robot went back to."""

    exit_code = 12


class UnreachableError(NobodyListensError):
    """No connection to the robot could be made."""


class ConnectionLostError(RobotLostError):
    """The connection was lost during an update; the robot ends by itself what it had begun to switch."""


def agent_archive() -> bytes:
    """The modules of the robot's side as a zip that Python runs; the same bytes each time."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr(zipfile.ZipInfo("__main__.py", _LONG_AGO), _MAIN)
        for package in _PACKAGES:
            folder = importlib.resources.files(package)
            for source in sorted(folder.iterdir(), key=lambda path: path.name):
                if source.name.endswith(".py") and (package == _PACKAGES[-1] or source.name == "__init__.py"):
                    name = f"{package.replace('.', '/')}/{source.name}"
                    archive.writestr(zipfile.ZipInfo(name, _LONG_AGO), source.read_bytes())
    return buffer.getvalue()


class Host:
    """A robot that requests are sent to, all over one connection.

    Args:
        address: As ssh takes it: `user@host`, or a name of the user's ssh configuration.
        config: An ssh configuration other than the user's.
        sudo: Whether the robot's side runs under `sudo -n`.
        root: Where releases lie on the robot.
        robot_config: Where `robot.yaml` lies on the robot.

    Raises:
        ConfigurationError: That is no address.
    """

    def __init__(
        self,
        address: str,
        *,
        config: Path | None = None,
        sudo: bool = False,
        root: str = ROOT,
        robot_config: str = ROBOT_CONFIG,
    ) -> None:
        if not address or address.startswith("-") or any(letter.isspace() for letter in address):
            raise ConfigurationError(f"{address!r} is no host; give HOST or USER@HOST")
        self.address = address
        self._config, self._sudo = config, sudo
        self._places = {"root": root, "config": robot_config}
        self._folder = tempfile.TemporaryDirectory(prefix="segway-", ignore_cleanup_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        words = self.command("-O", "exit")
        with contextlib.suppress(OSError, subprocess.TimeoutExpired):
            subprocess.run(words, capture_output=True, timeout=10.0, check=False)  # noqa: S603 - our own words
        self._folder.cleanup()

    def command(self, *options: str) -> list[str]:
        """The words that start ssh."""
        socket = Path(self._folder.name) / "ssh"
        config = ["-F", str(self._config)] if self._config is not None else []
        control = ["-o", f"ControlPath={socket}", "-o", "ControlPersist=300"]
        return ["ssh", *config, *_OPTIONS, *control, *options, "--", self.address]

    def ask(
        self,
        request: Mapping[str, Any],
        on_event: Callable[[Event], None],
        files: Mapping[str, Path] | None = None,
    ) -> Event:
        """Send a request, and the files that the robot then asks for; returns what the last event carries.

        Files that it may ask for lie at these places here, by their names; `on_event` is called with each event as it
        comes.

        Raises:
            UnreachableError: There is no connection.
            ConnectionLostError: The connection was lost.
            UpdateRefusedError: The robot refused.
        """
        remote = ["python3", "-I", "-B", "-c", BOOTSTRAP]
        words = [*self.command(), shlex.join([*(["sudo", "-n", "--"] if self._sudo else []), *remote])]
        with tempfile.TemporaryFile() as errors:
            try:
                process = subprocess.Popen(  # noqa: S603 - ssh, with one word that is quoted for the robot's shell
                    words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
                )
            except FileNotFoundError:
                raise ConfigurationError("there is no ssh here: sudo apt-get install openssh-client") from None
            try:
                return self._exchange(process, request, on_event, files or {}, errors)
            finally:
                _end(process)

    def _exchange(
        self,
        process: subprocess.Popen[bytes],
        request: Mapping[str, Any],
        on_event: Callable[[Event], None],
        files: Mapping[str, Path],
        errors: IO[bytes],
    ) -> Event:
        agent, step = agent_archive(), ""
        _send(process, f"{len(agent)}\n".encode(), agent, json.dumps({**self._places, **request}).encode() + b"\n")
        for line in process.stdout or ():
            try:
                event = json.loads(line)
                kind = event["event"]
            except (ValueError, TypeError, KeyError):
                continue  # what the robot's shell prints when it starts
            on_event(event)
            match kind:
                case "step":
                    step = event["step"]
                case "need":
                    _send_files(process, event["files"], files, request["release"]["files"])
                case "ready":
                    _send(process, b"go\n")
                case "refused":
                    raise UpdateRefusedError(f"{self.address}: {event['text']}")
                case "failed":
                    raise UpdateFailedError(f"{self.address}: {event['text']}; see: segway-ecc deploy status")
                case "end":
                    return {key: value for key, value in event.items() if key != "event"}
        raise self._lost(process, step, errors)

    def _lost(self, process: subprocess.Popen[bytes], step: str, errors: IO[bytes]) -> Exception:
        code = process.wait()
        errors.seek(0)
        lines = errors.read().decode(errors="replace").strip().splitlines()
        why = lines[-1] if lines else f"ssh ended with {code}"
        if step:
            return ConnectionLostError(
                f"the connection to {self.address} was lost in the step '{step}' ({why}); the robot goes on or stays "
                f"as it was, and reports how it ended: segway-ecc deploy status {self.address}"
            )
        if code == _NO_CONNECTION or code < 0:
            return UnreachableError(f"no connection to {self.address}: {why}")
        if code == _NO_COMMAND:
            return UpdateRefusedError(f"{self.address}: it has no python3, and 3.11 or later is needed")
        return UpdateRefusedError(f"{self.address}: {why}")


def _end(process: subprocess.Popen[bytes]) -> None:
    with contextlib.suppress(OSError):
        if process.stdin is not None:
            process.stdin.close()
    try:
        process.wait(10.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _send(process: subprocess.Popen[bytes], *pieces: bytes) -> None:
    """Send; where the other end has gone, its last message is worth more than a broken pipe."""
    with contextlib.suppress(BrokenPipeError):
        for piece in pieces:
            if process.stdin is not None:
                process.stdin.write(piece)
                process.stdin.flush()


def _send_files(
    process: subprocess.Popen[bytes],
    wanted: list[str],
    files: Mapping[str, Path],
    announced: Mapping[str, Mapping[str, Any]],
) -> None:
    lacking = [path for path in wanted if path not in files]
    if lacking:
        raise ConfigurationError(
            f"the robot's own {lacking[0]} is not as it was pushed: give the robot file with --robot FILE"
        )
    for path in wanted:
        left = announced[path]["size"]
        with files[path].open("rb") as file:
            while left and (piece := file.read(min(left, _CHUNK))):
                _send(process, piece)
                left -= len(piece)
        if left:
            raise ConfigurationError(f"{files[path]} became shorter while it was pushed; push again")
