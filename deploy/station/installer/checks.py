# SPDX-License-Identifier: MIT
"""Whether a machine can be a base station: checked before anything is written, and by asking the service once it runs.

Among it the program that the service runs, and whether the service's user can reach it.
"""

import contextlib
import importlib.util
import os
import re
import shutil
import ssl
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Final

from segway_ecc.deploy.station.installer.machine import USER, Owner, TargetMachine, acting_as
from segway_ecc.deploy.station.installer.settings import ENVIRONMENT, RELEASE, STATION, InstallSettings, is_plain_path
from segway_ecc.deploy.station.requirements import require_station
from segway_ecc.deploy.station.web.site_address import bind, tls_context
from segway_ecc.node.errors import ConfigurationError, NodeError

_PAUSE_S: Final = 0.2
_ANSWER_S: Final = 3.0
_EVERYWHERE: Final = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # noqa: S104 - compared, not bound
_PROGRAM: Final = "segway-ecc"
_RELEASES: Final = Path("/opt/segway-ecc")
_INSTALLED: Final = (RELEASE, "/usr/bin/segway-ecc", "/usr/local/bin/segway-ecc")
_HIDDEN: Final = tuple(map(Path, ("/home", "/root", "/run/user", "/tmp", "/var/tmp")))  # noqa: S108 - not written to
"""What the unit's ProtectHome= and PrivateTmp= hide from the service."""
_OF_ROS: Final = ("AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "PYTHONPATH")


def check_machine(machine: TargetMachine, settings: InstallSettings) -> None:
    """Systemd runs, and there is what the firewall needs.

    Raises:
        ConfigurationError: Something is missing.
    """
    if not machine.path("/run/systemd/system").is_dir():  # sd_booted(3)
        raise ConfigurationError(
            "no systemd runs here, which would start the station: use segway-ecc station serve, or --root for an image"
        )
    if settings.firewall is not None and shutil.which("nft") is None:
        raise ConfigurationError("--firewall needs nft, which is not installed: apt-get install nftables")


def check_rules(machine: TargetMachine, rules: str) -> None:
    """The kernel takes the firewall's rules; nothing is loaded.

    Raises:
        ConfigurationError: It does not.
    """
    try:
        machine.run(["nft", "--check", "--file", "-"], rules)
    except NodeError as error:
        raise ConfigurationError(
            f"--firewall: this kernel does not take the rules ({error}); it needs nf_tables with the family inet"
        ) from None


def check_place(machine: TargetMachine, settings: InstallSettings) -> None:
    """The address is ours, and the port free, or held by the station itself.

    Raises:
        ConfigurationError: One of them is not.
    """
    path = machine.path(ENVIRONMENT)
    text = path.read_text("utf-8", "replace") if path.is_file() else ""
    is_ours = re.search(rf"--port {settings.port}\b", text) is not None
    is_running = is_ours and machine.succeeds(["systemctl", "is-active", "--quiet", STATION])
    for bound in bind(settings.address, 0 if is_running else settings.port):
        bound.close()


def check_files(machine: TargetMachine, settings: InstallSettings, user: Owner | None = None) -> None:
    """Certificate and key can be used, by the service's user where one is given.

    Raises:
        ConfigurationError: They cannot.
    """
    if settings.certificate is None:
        return
    files = [path for _, path in settings.file_options]
    hidden = next(filter(is_hidden, files), None)
    if hidden is not None:
        raise ConfigurationError(f"{hidden} is not visible to the service: copy it to where it is, such as /etc/ssl")
    certificate = machine.path(str(settings.certificate))
    key = None if settings.key is None else machine.path(str(settings.key))
    if user is None:
        tls_context(certificate, key)
        return
    try:
        with acting_as(user):
            tls_context(certificate, key)
    except ConfigurationError as error:
        names = " ".join(map(str, files))
        raise ConfigurationError(
            f"as the user {USER}: {error}; let it read them: setfacl -m u:{USER}:r {names}"
        ) from None


def wait_until_healthy(
    settings: InstallSettings,
    timeout_ns: int,
    now_ns: Callable[[], int] = time.monotonic_ns,
    sleep: Callable[[float], None] = time.sleep,
) -> None:
    """Poll `GET /health` until the answer is `ok`.

    Raises:
        NodeError: It is not within `timeout_ns`; with the last problem and where to look.
    """
    end_ns = now_ns() + timeout_ns
    host = _EVERYWHERE.get(settings.address, settings.address)
    address = f"{settings.scheme}://{f'[{host}]' if ':' in host else host}:{settings.port}/health"
    while (problem := _problem(address)) is not None:
        if now_ns() >= end_ns:
            within = f"within {timeout_ns / 1e9:g} s"
            raise NodeError(
                f"the station is installed, but its health check did not pass {within} ({problem}); "
                f"see journalctl --unit {STATION} --lines 20"
            )
        sleep(_PAUSE_S)


def _problem(address: str) -> str | None:
    # No proxy, and no check of the certificate: it is for the name that browsers use, and we use the address.
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    handlers = (urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=context))
    try:
        with urllib.request.build_opener(*handlers).open(address, timeout=_ANSWER_S) as answer:
            content = answer.read(100)
    except urllib.error.HTTPError as error:
        error.close()
        return f"it answered {error.code}"
    except (OSError, ValueError) as error:
        return str(getattr(error, "reason", error))
    return None if content == b"ok\n" else "something else answered"


def command_for(machine: TargetMachine, chosen: str | None) -> str:
    """The program's path on the machine: the one that is chosen, or that of this environment or of the release there.

    Raises:
        ConfigurationError: There is none, or its path cannot stand in a unit.
    """
    if chosen:
        command = chosen
    elif machine.is_live:
        beside, started = Path(sys.executable).absolute().with_name(_PROGRAM), Path(sys.argv[0]).absolute()
        found = beside if beside.exists() or started.name != _PROGRAM else started
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
    require_station()
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
        raise ConfigurationError(f"there is no {_PROGRAM} in --root: none of {', '.join(_INSTALLED)}; see --command")
    return found
