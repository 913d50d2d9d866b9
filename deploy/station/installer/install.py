# SPDX-License-Identifier: MIT
"""Makes a machine a base station, and takes one away; doing it again changes what is different, and nothing else."""

import contextlib
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.installer.checks import (
    check_environment,
    check_files,
    check_machine,
    check_place,
    check_rules,
    command_for,
    ros_variables,
    wait_until_healthy,
)
from segway_ecc.deploy.station.installer.machine import ACCESS, Owner, TargetMachine, delete_tokens, make_tokens
from segway_ecc.deploy.station.installer.settings import (
    ALL_FILES,
    ENVIRONMENT,
    FIREWALL,
    PENDING,
    RULES,
    STATION,
    SYSUSERS,
    UNITS,
    InstallSettings,
    check,
    files,
)
from segway_ecc.deploy.station.web.access import Role
from segway_ecc.node.errors import NodeError

_WANTED: Final = f"{UNITS}/multi-user.target.wants"
_TIMEOUT_NS: Final = 60_000_000_000
_MAKE_USER: Final = ["systemd-sysusers", SYSUSERS]


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be done to a machine: with the settings, checked, the files that are to be written, text by path."""

    machine: TargetMachine
    settings: InstallSettings
    files: Mapping[str, str]

    @property
    def units(self) -> tuple[str, ...]:
        """Those that start at boot."""
        return (STATION,) if self.settings.firewall is None else (FIREWALL, STATION)


def plan(machine: TargetMachine, settings: InstallSettings, command: str | None) -> Plan:
    """Check everything that can be known before anything is written.

    Raises:
        ConfigurationError: A setting, or this machine, is not fit for it.
        RosUnavailableError: ROS is missing.
    """
    check(settings)
    program = command_for(machine, command)
    if machine.is_live:
        check_machine(machine, settings)
        check_environment(program)
        check_place(machine, settings)
    check_files(machine, settings)
    made = files(settings, program, ros_variables() if machine.is_live else {})
    if RULES in made and machine.is_live and os.geteuid() == 0:  # only root may ask the kernel
        check_rules(machine, made[RULES])
    return Plan(machine, settings, made)


def install(made: Plan, *, new_tokens: bool, show: Callable[[Mapping[Role, str]], None]) -> list[str]:
    """Do what is planned; returns the files that were changed.

    With `new_tokens` tokens that are there are replaced; `show` is called with new ones as soon as they are kept, since
    nobody can show them later.

    Raises:
        NodeError: Something did not go through; doing it again goes on from there.
    """
    machine = made.machine
    was_interrupted = machine.is_live and not machine.write(PENDING, "")
    changed = [SYSUSERS] if machine.write(SYSUSERS, made.files[SYSUSERS]) else []
    owner = _user(machine)
    if machine.is_live:
        check_files(machine, made.settings, owner)
    tokens = make_tokens(machine, owner, anew=new_tokens)
    if tokens:
        show(tokens)
    changed += [name for name, text in made.files.items() if machine.write(name, text)]
    if made.settings.firewall is None:
        if machine.is_live and machine.path(f"{UNITS}/{FIREWALL}").exists():
            machine.run(["systemctl", "--quiet", "disable", "--now", FIREWALL])
        for name in (f"{_WANTED}/{FIREWALL}", f"{UNITS}/{FIREWALL}", RULES):
            machine.delete(name)
    if machine.is_live:
        machine.run(["systemctl", "daemon-reload"])
        for words in _starting(made, is_changed=bool(was_interrupted or changed or tokens)):
            machine.run(words)
        wait_until_healthy(made.settings, _TIMEOUT_NS)
        machine.delete(PENDING)
        return changed
    for unit in made.units:  # what `systemctl enable` does
        link = machine.path(f"{_WANTED}/{unit}")
        link.parent.mkdir(parents=True, exist_ok=True)
        if not link.is_symlink():
            link.symlink_to(f"{UNITS}/{unit}")
    return changed


def commands(made: Plan) -> list[list[str]]:
    """What is run on this machine, in order."""
    if not made.machine.is_live:
        return []
    return [_MAKE_USER, ["systemctl", "daemon-reload"], *_starting(made, is_changed=True)]


def _user(machine: TargetMachine) -> Owner:
    if machine.is_live:
        machine.run(_MAKE_USER)
    elif machine.owner() is None and os.geteuid() == 0 and shutil.which("systemd-sysusers"):
        machine.run(["systemd-sysusers", f"--root={machine.root}", Path(SYSUSERS).name])
    owner = machine.owner()
    if owner is not None:
        return owner
    if machine.is_live:
        raise NodeError(f"systemd-sysusers made no user of {SYSUSERS}")
    # Not as root: whoever packs the folder sets their owner.
    return Owner(os.geteuid(), os.getegid())


def _starting(made: Plan, *, is_changed: bool) -> list[list[str]]:
    """A station that is as it should be is not restarted: its operators stay logged in."""
    # New rules take the place of the old ones in one step; a restart would leave the ports open in between.
    verbs = {FIREWALL: "reload-or-restart", STATION: "restart"} if is_changed else {}
    starting = [["systemctl", verbs.get(unit, "start"), unit] for unit in made.units]
    return [["systemctl", "--quiet", "enable", *made.units], *starting]


def remove(machine: TargetMachine) -> list[str]:
    """Stop the service and delete its files, but for its logs; returns the files that were deleted.

    The user stays: the logs are its own, and the number must not become somebody else's.

    Raises:
        NodeError: Something could not be stopped or deleted.
    """
    if machine.is_live:
        for unit in (STATION, FIREWALL):
            if machine.path(f"{UNITS}/{unit}").exists():
                machine.run(["systemctl", "--quiet", "disable", "--now", unit])
    gone = [ACCESS] if delete_tokens(machine) else []
    links = [f"{_WANTED}/{unit}" for unit in (STATION, FIREWALL)]
    gone += [name for name in (*links, *ALL_FILES) if machine.delete(name)]
    with contextlib.suppress(OSError):  # where something else of ours is in it
        machine.path(ENVIRONMENT).parent.rmdir()
    if machine.is_live:
        machine.run(["systemctl", "daemon-reload"])
    return gone
