"""Whether a machine can be a base station, told before anything is written."""

import re
import shutil
from pathlib import Path

from segway_ecc.deploy.station.installer.machine import USER, Owner, TargetMachine, acting_as
from segway_ecc.deploy.station.installer.program import is_hidden
from segway_ecc.deploy.station.installer.rendering import ENVIRONMENT, STATION
from segway_ecc.deploy.station.installer.settings import InstallSettings
from segway_ecc.deploy.station.web.listening import bind, tls_context
from segway_ecc.node.errors import ConfigurationError, NodeError


def check_machine(machine: TargetMachine, settings: InstallSettings) -> None:
    """Systemd runs, and there is what the firewall needs.

    Raises:
        ConfigurationError: Something is missing.
    """
    if not machine.has_systemd():
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
    for bound in bind(settings.address, settings.port if _port_in_use(machine) != settings.port else 0):
        bound.close()


def check_files(machine: TargetMachine, settings: InstallSettings, user: Owner | None = None) -> None:
    """Certificate and key can be used, by the service's user where one is given.

    Raises:
        ConfigurationError: They cannot.
    """
    if settings.certificate is None:
        return
    hidden = next((path for path in settings.files if is_hidden(path)), None)
    if hidden is not None:
        raise ConfigurationError(
            f"{hidden} is out of the service's sight: copy it to where it is not, such as /etc/ssl"
        )
    certificate = machine.path(str(settings.certificate))
    key = None if settings.key is None else machine.path(str(settings.key))
    if user is None:
        tls_context(certificate, key)
        return
    try:
        with acting_as(user):
            tls_context(certificate, key)
    except ConfigurationError as error:
        names = " ".join(map(str, settings.files))
        raise ConfigurationError(
            f"as the user {USER}: {error}; let it read them: setfacl -m u:{USER}:r {names}"
        ) from None


def _port_in_use(machine: TargetMachine) -> int | None:
    """The port that our own service listens on now."""
    try:
        text = Path(machine.path(ENVIRONMENT)).read_text("utf-8", "replace")
    except OSError:
        return None
    found = re.search(r"--port ([0-9]+)", text)
    is_running = found is not None and machine.succeeds(["systemctl", "is-active", "--quiet", STATION])
    return int(found[1]) if found is not None and is_running else None
