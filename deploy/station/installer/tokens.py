# SPDX-License-Identifier: MIT
"""The tokens of a base station, kept as `segway-ecc station serve` keeps them: as hashes, in the station's folder."""

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.installer.machine import Owner, TargetMachine, acting_as
from segway_ecc.deploy.station.web.access import Role, load_access, new_access
from segway_ecc.node.errors import ConfigurationError, NodeError

STATE: Final = "/var/lib/segway-ecc"
FOLDER: Final = f"{STATE}/station"
ACCESS: Final = f"{FOLDER}/access.json"


def has_tokens(machine: TargetMachine) -> bool:
    """Whether tokens are kept, whole or not."""
    return os.path.lexists(machine.path(ACCESS))


def make_tokens(machine: TargetMachine, owner: Owner, *, anew: bool) -> Mapping[Role, str]:
    """Make tokens where there are none, or in place of those that are there; empty where they stay.

    Args:
        machine: Where.
        owner: The service's user.
        anew: Whether the old ones become invalid.

    Raises:
        ConfigurationError: The file is none of ours.
        NodeError: It cannot be written.
    """
    with _in_state(machine, owner):
        path = machine.path(ACCESS)
        if not anew and load_access(path) is not None:
            return {}
        access, tokens = new_access()
        access.save(path)
        if not machine.is_live:
            _give(path.parent, owner)
            _give(path, owner)
    return tokens


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


@contextmanager
def _in_state(machine: TargetMachine, owner: Owner) -> Iterator[None]:
    """The service's folder exists; on a running machine everything in it is done as its user."""
    state = machine.path(STATE)
    try:
        if not state.exists():
            state.mkdir(parents=True, mode=0o750)
            _give(state, owner)
        with acting_as(owner) if machine.is_live else nullcontext():
            folder = machine.path(FOLDER)
            folder.mkdir(exist_ok=True, mode=0o700)
            if folder.is_symlink():
                raise ConfigurationError(f"{folder} is a link; it has to be a folder of the service's user")
            folder.chmod(0o700)
            yield
    except OSError as error:
        raise NodeError(f"{state} cannot be made ready: {error.strerror}") from None


def _give(path: Path, owner: Owner) -> None:
    if os.geteuid() == 0:
        os.chown(path, owner.uid, owner.gid, follow_symlinks=False)
