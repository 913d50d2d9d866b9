# SPDX-License-Identifier: MIT
"""Whether a machine can be a base station, checked before anything is written."""

import re
import shutil

from segway_ecc.deploy.station.installer.machine import USER, Owner, TargetMachine, acting_as
from segway_ecc.deploy.station.installer.program import is_hidden
from segway_ecc.deploy.station.installer.rendering import ENVIRONMENT, STATION
from segway_ecc.deploy.station.installer.settings import InstallSettings
from segway_ecc.deploy.station.web.site_address import bind, tls_context
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
