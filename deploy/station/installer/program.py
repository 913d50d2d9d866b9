# SPDX-License-Identifier: MIT
"""The program that the service runs, and whether the service's user can reach it."""

import contextlib
import importlib.util
import os
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.installer.machine import TargetMachine
from segway_ecc.deploy.station.installer.rendering import RELEASE
from segway_ecc.deploy.station.installer.settings import is_plain_path
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.ros.runtime import require_ros

_NAME: Final = "segway-ecc"
_RELEASES: Final = Path("/opt/segway-ecc")
_INSTALLED: Final = (RELEASE, "/usr/bin/segway-ecc", "/usr/local/bin/segway-ecc")
_HIDDEN: Final = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))  # noqa: S108 - not written to
"""What the unit's ProtectHome= and PrivateTmp= hide from the service."""
_OF_ROS: Final = ("AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH")


def command_for(machine: TargetMachine, chosen: str | None) -> str:
    """The program's path on the machine: the one that is chosen, or that of this environment or of the release there.

    Raises:
        ConfigurationError: There is none, or its path cannot stand in a unit.
    """
    if chosen:
        command = chosen
    elif machine.is_live:
        beside, started = Path(sys.executable).absolute().with_name(_NAME), Path(sys.argv[0]).absolute()
        found = beside if beside.exists() or started.name != _NAME else started
        # A release is left when the next one comes; the link in front of it stays.
        command = RELEASE if found.is_relative_to(_RELEASES) else str(found)
    else:
        command = _of_that_system(machine)
    if not is_plain_path(command):
        raise ConfigurationError(f"the program {command!r} needs an absolute path of letters, digits and ._+@:,/-")
    # The link to the release in use may be absolute, and is not followed in a root file system of another machine.
    if command != RELEASE and not os.path.lexists(machine.path(command)):
        raise ConfigurationError(f"--command {command}: there is no such program")
    return command


def check_environment(command: str) -> None:
    """Make sure that this environment can serve, and that the service's user can reach it.

    Raises:
        ConfigurationError: Something is missing or out of reach.
        RosUnavailableError: ROS is missing.
    """
    if importlib.util.find_spec("aiohttp") is None:
        raise ConfigurationError(
            "the station serves with aiohttp, which is not installed: pip install 'segway-ecc[station]'"
        )
    require_ros()
    needed = [Path(command), Path(sys.executable)]
    for package in ("segway_ecc", "aiohttp", "rclpy"):
        spec = importlib.util.find_spec(package)
        if spec is None or spec.origin is None:
            raise ConfigurationError(f"the package {package} has no file")
        needed.append(Path(spec.origin))
    closed = first_closed(needed)
    if closed is not None:
        raise ConfigurationError(
            f"{closed} is not visible to the service: make the environment elsewhere and of a Python that everybody "
            "may use, such as: /usr/bin/python3 -m venv /opt/segway-ecc-station"
        )


def first_closed(paths: Iterable[Path]) -> Path | None:
    """The first file or folder that a user of the system, in the unit's sandbox, cannot reach or pass through."""
    for path in paths:
        for form in (path.absolute(), path.resolve()):
            if is_hidden(form):
                return form
            for step in (*reversed(form.parents), form):
                with contextlib.suppress(OSError):  # what is missing is reported by who needs it
                    if not step.stat().st_mode & (0o001 if step.is_dir() else 0o004):
                        return step
    return None


def is_hidden(path: Path) -> bool:
    """Whether the unit's sandbox hides a path from the service."""
    return any(path.is_relative_to(hidden) for hidden in _HIDDEN)


def ros_variables(variables: Mapping[str, str] = os.environ) -> dict[str, str]:
    """The variables of a ROS 2 that was sourced here, which the service needs; empty where none was.

    Raises:
        ConfigurationError: A value cannot stand in a file of variables.
    """
    if not variables.get("AMENT_PREFIX_PATH"):
        return {}
    found = {name: variables[name] for name in _OF_ROS if variables.get(name)}
    for name, value in found.items():
        if not all(is_plain_path(part) for part in value.split(os.pathsep) if part):
            raise ConfigurationError(
                f"{name}={value!r} cannot be passed to a service: letters, digits and ._+@:,/- only"
            )
    return found


def _of_that_system(machine: TargetMachine) -> str:
    if os.path.lexists(machine.path("/opt/segway-ecc/current")):
        return RELEASE
    found = next((name for name in _INSTALLED if os.path.lexists(machine.path(name))), None)
    if found is None:
        raise ConfigurationError(f"there is no {_NAME} in --root: none of {', '.join(_INSTALLED)}; see --command")
    return found
