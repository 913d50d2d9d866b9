# SPDX-License-Identifier: MIT
"""The connection to a robot: the system's own ssh, so that the user's configuration, keys and jump hosts hold."""

import contextlib
import json
import shlex
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self

from segway_ecc.deploy.release.archive import BOOTSTRAP, agent_archive
from segway_ecc.deploy.release.errors import (
    ConnectionLostError,
    UnreachableError,
    UpdateFailedError,
    UpdateRefusedError,
)
from segway_ecc.node.errors import ConfigurationError

Event = Mapping[str, Any]
_NO_CONNECTION: Final = 255
_NO_COMMAND: Final = 127
_CHUNK: Final = 2**18
# A small computer that installs may not get round to an answer for half a minute.
_OPTIONS: Final = ("-T", "-o", "ServerAliveInterval=10", "-o", "ServerAliveCountMax=6", "-o", "ControlMaster=auto")


class Host:
    """A robot that requests are sent to, all over one connection.

    Args:
        address: As ssh takes it: `user@host`, or a name of the user's ssh configuration.
        config: An ssh configuration other than the user's.
        sudo: Whether the robot's side runs under `sudo -n`.

    Raises:
        ConfigurationError: That is no address.
    """

    def __init__(self, address: str, *, config: Path | None = None, sudo: bool = False) -> None:
        if not address or address.startswith("-") or any(letter.isspace() for letter in address):
            raise ConfigurationError(f"{address!r} is no host; give HOST or USER@HOST")
        self.address = address
        self._config, self._sudo = config, sudo
        self._folder = tempfile.TemporaryDirectory(prefix="segway-", ignore_cleanup_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the connection."""
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
        """Send a request, and the files that the robot then asks for.

        Args:
            request: What is to be done.
            on_event: Called with each event as it comes.
            files: Where the files lie that the robot may ask for.

        Returns:
            The last event.

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
        _send(process, f"{len(agent)}\n".encode(), agent, json.dumps(request).encode() + b"\n")
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
                    return dict(event)
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
