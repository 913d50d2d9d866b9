# SPDX-License-Identifier: MIT
"""The machine that becomes a base station: this one, or a root file system in a folder; and the tokens kept there.

The tokens are kept as `segway-ecc station serve` keeps them: as hashes, in the station's folder.
"""

import contextlib
import os
import shutil
import stat
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from segway_ecc.deploy.release.agent.files import write_whole
from segway_ecc.deploy.station.web.access import Role, load_access, new_access
from segway_ecc.node.errors import ConfigurationError, NodeError

USER: Final = "segway"
_PASSWD_FIELDS: Final = 7
_MODE: Final = 0o644
STATE: Final = "/var/lib/segway-ecc"
FOLDER: Final = f"{STATE}/station"
ACCESS: Final = f"{FOLDER}/access.json"


class Owner(NamedTuple):
    """A user of the machine, by its numbers."""

    uid: int
    gid: int


class TargetMachine:
    """Files below a root folder, and commands where that is the running system."""

    def __init__(self, root: Path = Path("/"), *, is_live: bool = True) -> None:
        """Use a root folder; `is_live` is whether services can be started there."""
        self.root = root
        self.is_live = is_live

    def path(self, name: str) -> Path:
        """Where a file of the machine lies for us.

        Raises:
            ConfigurationError: A link leads out of the root file system.
        """
        path = self.root / name.lstrip("/")
        root = self.root.resolve()
        if not path.parent.resolve().is_relative_to(root):
            raise ConfigurationError(f"{path.parent} leads out of {self.root}: a link there is not relative")
        return path

    def owner(self) -> Owner | None:
        """The service's user, or None where there is none yet."""
        try:
            lines = self.path("/etc/passwd").read_text("utf-8", "surrogateescape").splitlines()
        except FileNotFoundError:
            return None
        entries = (line.split(":") for line in lines)
        found = (entry for entry in entries if entry[0] == USER and len(entry) == _PASSWD_FIELDS)
        return next((Owner(int(entry[2]), int(entry[3])) for entry in found), None)

    def write(self, name: str, text: str) -> bool:
        """Write a file that everybody may read, whole or not at all; return whether anything changed.

        Raises:
            NodeError: It cannot be written.
        """
        path = self.path(name)
        try:
            content = text.encode()
            with contextlib.suppress(FileNotFoundError):
                mode = path.lstat().st_mode
                if stat.S_ISREG(mode) and stat.S_IMODE(mode) == _MODE and path.read_bytes() == content:
                    return False
            path.parent.mkdir(parents=True, exist_ok=True, mode=0o755)
            write_whole(path, content, _MODE)
        except OSError as error:
            raise NodeError(f"{path} cannot be written: {error.strerror}") from None
        return True

    def delete(self, name: str) -> bool:
        """Delete a file or a link; return whether it was there.

        Raises:
            NodeError: It cannot be deleted.
        """
        path = self.path(name)
        try:
            path.unlink()
        except (FileNotFoundError, NotADirectoryError):
            return False
        except OSError as error:
            raise NodeError(f"{path} cannot be deleted: {error.strerror}") from None
        return True

    def succeeds(self, words: Sequence[str]) -> bool:
        """Whether a command ends well."""
        return _run(words).returncode == 0

    def run(self, words: Sequence[str], text: str = "") -> None:
        """Run a command, which reads `text`.

        Raises:
            NodeError: It fails; with the first error that it prints, or its last line.
        """
        done = _run(words, text)
        if done.returncode != 0:
            lines = done.stderr.strip().splitlines() or [f"exit code {done.returncode}"]
            named = next((line for line in lines if "Error: " in line), lines[-1])
            raise NodeError(f"{' '.join(words)}: {named}")


@contextlib.contextmanager
def acting_as(owner: Owner) -> Iterator[None]:
    """Have the kernel take us for a user while the context lasts.

    Root that writes into a folder of somebody else would follow whatever link they put there.
    """
    if os.geteuid() == owner.uid:
        yield
        return
    gid, groups = os.getegid(), os.getgroups()
    os.setgroups([])
    os.setegid(owner.gid)
    os.seteuid(owner.uid)
    try:
        yield
    finally:
        os.seteuid(0)
        os.setegid(gid)
        os.setgroups(groups)


def _run(words: Sequence[str], text: str = "") -> "subprocess.CompletedProcess[str]":
    program = shutil.which(words[0])
    if program is None:
        raise NodeError(f"{words[0]} is not installed here")
    words = [program, *words[1:]]
    return subprocess.run(words, check=False, capture_output=True, text=True, input=text)  # noqa: S603 - ours


def has_tokens(machine: TargetMachine) -> bool:
    """Whether tokens are kept, whole or not."""
    return os.path.lexists(machine.path(ACCESS))


def make_tokens(machine: TargetMachine, owner: Owner, *, anew: bool) -> Mapping[Role, str]:
    """Make tokens of the service's user where there are none, or `anew`; empty where those that are there stay.

    The service's folder is made too; on a running machine everything in it is done as its user.

    Raises:
        ConfigurationError: The file is none of ours.
        NodeError: It cannot be written.
    """
    state = machine.path(STATE)
    try:
        if not state.exists():
            state.mkdir(parents=True, mode=0o750)
            _give(state, owner)
        with acting_as(owner) if machine.is_live else contextlib.nullcontext():
            folder, path = machine.path(FOLDER), machine.path(ACCESS)
            folder.mkdir(exist_ok=True, mode=0o700)
            if folder.is_symlink():
                raise ConfigurationError(f"{folder} is a link; it has to be a folder of the service's user")
            folder.chmod(0o700)
            if not anew and load_access(path) is not None:
                return {}
            access, tokens = new_access()
            access.save(path)
            if not machine.is_live:
                _give(folder, owner)
                _give(path, owner)
            return tokens
    except OSError as error:
        raise NodeError(f"{state} cannot be made ready: {error.strerror}") from None


def is_the_service_s(machine: TargetMachine) -> bool:
    """Whether the service's user can read them: it is known on that machine, and the file is its own."""
    owner = machine.owner()
    return owner is not None and machine.path(ACCESS).lstat().st_uid == owner.uid


def delete_tokens(machine: TargetMachine) -> bool:
    """Delete them; return whether there were any."""
    owner = machine.owner()
    if not machine.is_live or owner is None:
        return machine.delete(ACCESS)
    with acting_as(owner):
        return machine.delete(ACCESS)


def _give(path: Path, owner: Owner) -> None:
    if os.geteuid() == 0:
        os.chown(path, owner.uid, owner.gid, follow_symlinks=False)
