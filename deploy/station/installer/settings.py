# SPDX-License-Identifier: MIT
"""The settings of a base station, checked, and the files of one, made from them and from those that are shipped."""

import importlib.metadata
import ipaddress
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Final

from segway_ecc.node.errors import ConfigurationError

_CLEAR_DOMAINS: Final = (range(102), range(215, 233))
"""Those whose ports Linux does not hand out to other programs (ROS 2, 'About ROS domain IDs')."""
_PORTS: Final = range(1024, 65_536)
"""Lower ones need a privilege that the service does not have."""
_FIRST_DDS_PORT: Final = 7400
_DDS_PORTS_OF_A_DOMAIN: Final = 250
_LAST_PORT: Final = 65_535
_LABEL: Final = "[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?"
_HOST_NAME: Final = re.compile(rf"{_LABEL}(\.{_LABEL})*")
_LONGEST_NAME: Final = 253
_PATH: Final = re.compile(r"/[A-Za-z0-9._+@:,/-]*")
_INTERFACE: Final = re.compile(r"[A-Za-z0-9_.-]{1,15}")
DISCOVERY: Final = ("subnet", "localhost")
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


@dataclass(frozen=True, slots=True)
class InstallSettings:
    """A base station's settings.

    Attributes:
        domain: Of ROS.
        discovery: How far ROS looks for robots besides the peers: one of `DISCOVERY`, or empty for what fits the peers.
        peers: Machines that ROS asks by name or IPv4 address.
        address: Where the page is served.
        port: The same.
        hosts: Other names by which browsers find us.
        certificate: For TLS, a path on the base station.
        key: Its private key, where it is not in the same file.
        firewall: The network interface that robots and browsers are let in through, or None for no firewall.
    """

    domain: int = 0
    discovery: str = ""
    peers: tuple[str, ...] = ()
    address: str = "127.0.0.1"
    port: int = 8700
    hosts: tuple[str, ...] = ()
    certificate: Path | None = None
    key: Path | None = None
    firewall: str | None = None

    @property
    def scheme(self) -> str:
        """Of the page's address."""
        return "http" if self.certificate is None else "https"

    @property
    def is_loopback(self) -> bool:
        """Whether the page is for this machine only, judging by the address."""
        if self.address == "localhost":
            return True
        return _is_address(self.address) and ipaddress.ip_address(self.address).is_loopback

    @property
    def file_options(self) -> list[tuple[str, Path]]:
        """Certificate and key, where they are given, by option."""
        options = (("--certificate", self.certificate), ("--key", self.key))
        return [(option, path) for option, path in options if path is not None]

    @property
    def dds_ports(self) -> tuple[int, int]:
        """First and last UDP port of the domain (DDSI-RTPS 2.2, 9.6.1.1)."""
        first = _FIRST_DDS_PORT + _DDS_PORTS_OF_A_DOMAIN * self.domain
        return first, min(first + _DDS_PORTS_OF_A_DOMAIN - 1, _LAST_PORT)


def check(settings: InstallSettings) -> None:
    """Refuse what no service could use.

    Raises:
        ConfigurationError: With the option and what it may be.
    """
    if not any(settings.domain in clear for clear in _CLEAR_DOMAINS):
        raise ConfigurationError(
            f"--domain {settings.domain}: it is 0 to 101 or 215 to 232; Linux gives the ports of others to any program"
        )
    if settings.discovery not in ("", *DISCOVERY):
        raise ConfigurationError(f"--discovery {settings.discovery}: it is one of {', '.join(DISCOVERY)}")
    if settings.port not in _PORTS:
        raise ConfigurationError(f"--port {settings.port}: it is {_PORTS[0]} to {_PORTS[-1]} for a service")
    if not _is_address(settings.address) and not _is_name(settings.address):
        raise ConfigurationError(f"--address {settings.address!r}: it is an address of this machine, or a name of it")
    _check_names("--peer", settings.peers)
    _check_names("--host", settings.hosts)
    if settings.key is not None and settings.certificate is None:
        raise ConfigurationError("--key is of no use without --certificate")
    for option, path in settings.file_options:
        if not is_plain_path(str(path)):
            raise ConfigurationError(f"{option} {path}: it is an absolute path of letters, digits and ._+@:,/-")
    if settings.firewall is not None and _INTERFACE.fullmatch(settings.firewall) is None:
        raise ConfigurationError(f"--firewall {settings.firewall!r}: it is the name of a network interface")


def environment(settings: InstallSettings, ros: Mapping[str, str]) -> str:
    """The file of variables that the service reads; `ros` is empty where Python finds ROS 2 by itself.

    Each variable of discovery is there, also where it is empty: a robot's own settings on the same machine are not
    the station's.
    """
    options = ["--address", settings.address, "--port", str(settings.port), "--require-token"]
    for host in settings.hosts:
        options += ["--host", host]
    for option, path in settings.file_options:
        options += [option, str(path)]
    reach = settings.discovery or ("localhost" if settings.peers else "subnet")
    variables = {
        **ros,
        "ROS_DOMAIN_ID": str(settings.domain),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": reach.upper(),
        "ROS_STATIC_PEERS": ";".join(settings.peers),
        "STATION_OPTIONS": " ".join(options),
    }
    lines = (f'{name}="{value}"\n' for name, value in variables.items())
    return "# Written by `segway-ecc station install`, which writes it anew each time.\n" + "".join(lines)


def is_plain_path(path: str) -> bool:
    """Whether a path can stand in a unit without quotes or escapes."""
    return _PATH.fullmatch(path) is not None


def _check_names(option: str, names: Iterable[str]) -> None:
    for name in names:
        if not _is_name(name) and (not _is_address(name) or ":" in name):
            raise ConfigurationError(f"{option} {name!r}: it is the name of a machine, or an IPv4 address")


def _is_name(text: str) -> bool:
    """Whether it is a host's name (RFC 1123, 2.1): what ends in a number is an address, or nothing."""
    if len(text) > _LONGEST_NAME or _HOST_NAME.fullmatch(text) is None:
        return False
    return not text.rpartition(".")[2].isdecimal()


def _is_address(text: str) -> bool:
    try:
        return getattr(ipaddress.ip_address(text), "scope_id", None) is None
    except ValueError:
        return False


def files(settings: InstallSettings, command: str, ros: Mapping[str, str]) -> dict[str, str]:
    """What is to be written, text by path: by settings, the service's program and variables of a sourced ROS."""
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
