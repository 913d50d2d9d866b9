# SPDX-License-Identifier: MIT
"""The files of a base station, made from those that are shipped."""

import importlib.metadata
from collections.abc import Mapping
from importlib import resources
from typing import Final

from segway_ecc.deploy.station.installer.settings import InstallSettings, environment
from segway_ecc.node.errors import ConfigurationError

STATION: Final = "segway-ecc-station.service"
FIREWALL: Final = "segway-ecc-firewall.service"
UNITS: Final = "/etc/systemd/system"
SYSUSERS: Final = "/etc/sysusers.d/segway-ecc-station.conf"
ENVIRONMENT: Final = "/etc/segway-ecc/station.environment"
RULES: Final = "/etc/segway-ecc/base-station.nft"
PENDING: Final = "/etc/segway-ecc/station.pending"
"""There while changes are written that the service may not know of yet."""

ALL_FILES: Final = (SYSUSERS, ENVIRONMENT, RULES, f"{UNITS}/{STATION}", f"{UNITS}/{FIREWALL}", PENDING)
RELEASE: Final = "/opt/segway-ecc/current/venv/bin/segway-ecc"

_VARIABLES: Final = f"EnvironmentFile=-{ENVIRONMENT}\n"
_AFTER: Final = "After=network-online.target\n"


def files(settings: InstallSettings, command: str, ros: Mapping[str, str]) -> dict[str, str]:
    """What is to be written: text by path.

    Args:
        settings: Checked.
        command: The program that the service runs.
        ros: Variables of a sourced ROS 2.
    """
    station = _replaced(_shipped("systemd", STATION), f"ExecStart={RELEASE} ", f"ExecStart={command} ")
    # After the robot's, where this machine is one too: what comes later counts.
    station = _replaced(station, _VARIABLES, f"EnvironmentFile={ENVIRONMENT}\n")
    firewall = {}
    if settings.firewall is not None:
        # DDS does not use an interface that comes up later; of one that is not WireGuard's there is no such service.
        station = _replaced(station, _AFTER, f"{_AFTER}After=wg-quick@{settings.firewall}.service\n")
        firewall = {
            RULES: _rules(settings, settings.firewall),
            f"{UNITS}/{FIREWALL}": _shipped("station/installer", FIREWALL),
        }
    version = importlib.metadata.version("segway-ecc")
    head = f"# Written by `segway-ecc station install` {version}, which writes it anew each time.\n"
    return {
        SYSUSERS: _shipped("systemd", "segway-ecc.sysusers.conf"),
        ENVIRONMENT: environment(settings, ros),
        f"{UNITS}/{STATION}": head + station,
        **firewall,
    }


def _rules(settings: InstallSettings, interface: str) -> str:
    first, last = settings.dds_ports
    text = _shipped("station/installer", "base-station.nft")
    for old, new in (
        ("#   sudo nft -f base-station.nft\n", f"#   sudo nft -f {RULES}\n"),
        (
            "# The ports are those of ROS domain 42: 7400 + 250 * 42 and the 249 after it (DDSI-RTPS 2.2, 9.6.1.1).\n",
            f"# The ports are those of ROS domain {settings.domain} (DDSI-RTPS 2.2, 9.6.1.1).\n",
        ),
        ("define dds_ports = 17900-18149\n", f"define dds_ports = {first}-{last}\n"),
        ("define page_port = 8700\n", f"define page_port = {settings.port}\n"),
    ):
        text = _replaced(text, old, new)
    return text.replace('"wg-robots"', f'"{interface}"').replace(
        "inside the WireGuard network.", f"behind {interface}."
    )


def _replaced(text: str, old: str, new: str) -> str:
    if text.count(old) != 1:
        raise ConfigurationError(f"a file that is shipped is not as expected: {old.strip()!r} is not in it once")
    return text.replace(old, new)


def _shipped(folder: str, name: str) -> str:
    return (resources.files("segway_ecc.deploy") / folder / name).read_text("utf-8")
