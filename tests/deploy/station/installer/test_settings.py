# SPDX-License-Identifier: MIT
import dataclasses
import shlex
from pathlib import Path
from typing import Any

import pytest

from segway_ecc.deploy.station.installer.settings import InstallSettings, check, environment
from segway_ecc.node.errors import ConfigurationError


def variables(settings: InstallSettings, **ros: str) -> dict[str, str]:
    """As a shell reads the file, and systemd's EnvironmentFile."""
    words = shlex.split(environment(settings, ros), comments=True)
    return {key: value for key, _, value in (word.partition("=") for word in words)}


def test_alone_it_finds_robots_on_the_whole_network_and_serves_this_machine_only() -> None:
    check(InstallSettings())
    assert variables(InstallSettings()) == {
        "ROS_DOMAIN_ID": "0",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "ROS_STATIC_PEERS": "",  # output, so that a robot's own settings on this machine do not count
        "STATION_OPTIONS": "--address 127.0.0.1 --port 8700 --require-token",
    }


def test_with_peers_it_asks_them_only() -> None:
    settings = InstallSettings(domain=42, peers=("alice", "10.42.0.12"))
    check(settings)
    found = variables(settings)
    assert found["ROS_DOMAIN_ID"] == "42"
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"  # with OFF, ROS ignores the peers
    assert found["ROS_STATIC_PEERS"] == "alice;10.42.0.12"
    assert variables(dataclasses.replace(settings, discovery="subnet"))["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"


def test_each_option_of_the_page_is_handed_on() -> None:
    settings = InstallSettings(
        address="0.0.0.0",  # noqa: S104 - a text
        port=9000,
        hosts=("base.example", "base"),
        certificate=Path("/etc/ssl/c.pem"),
        key=Path("/etc/ssl/k.pem"),
    )
    check(settings)
    assert variables(settings)["STATION_OPTIONS"] == (
        "--address 0.0.0.0 --port 9000 --require-token --host base.example --host base "
        "--certificate /etc/ssl/c.pem --key /etc/ssl/k.pem"
    )


def test_sourced_ros_variables_are_returned() -> None:
    assert variables(InstallSettings(), AMENT_PREFIX_PATH="/opt/ros/jazzy")["AMENT_PREFIX_PATH"] == "/opt/ros/jazzy"


@pytest.mark.parametrize(
    ("changes", "output"),
    [
        ({"domain": -1}, "--domain -1: it is 0 to 101 or 215 to 232"),
        ({"domain": 102}, "--domain 102"),
        ({"domain": 214}, "--domain 214"),
        ({"domain": 233}, "--domain 233"),
        ({"discovery": "off"}, "--discovery off: it is one of subnet, localhost"),
        ({"port": 0}, "--port 0: it is 1024 to 65535"),
        ({"port": 1023}, "--port 1023"),
        ({"port": 65536}, "--port 65536"),
        ({"address": "192.0.2.256"}, "--address '192.0.2.256'"),
        ({"address": "a b"}, "--address 'a b'"),
        ({"address": ""}, "--address ''"),
        ({"address": "fe80::1%eth0"}, "--address 'fe80::1%eth0'"),
        ({"address": "127.0.0.1 --folder /tmp"}, "--address '127.0.0.1 --folder /tmp'"),
        ({"peers": ("alice", "al ice")}, "--peer 'al ice': it is the name of a machine, or an IPv4 address"),
        ({"peers": ("alice;bob",)}, "--peer 'alice;bob'"),
        ({"peers": ("",)}, "--peer ''"),
        ({"peers": ("10.42.0.300",)}, "--peer '10.42.0.300'"),
        ({"peers": ("10.42.0",)}, "--peer '10.42.0'"),
        ({"peers": ("::1",)}, "--peer '::1'"),
        ({"peers": ("-alice",)}, "--peer '-alice'"),
        ({"peers": ('al"ice',)}, "--peer 'al\"ice'"),
        ({"peers": ("a.", "b")}, "--peer 'a.'"),
        ({"peers": ("a" * 64,)}, "--peer 'aaa"),
        ({"peers": (".".join(["abc"] * 64),)}, "--peer 'abc."),
        ({"peers": ("alice\n",)}, "--peer 'alice\\n'"),
        ({"hosts": ("base station",)}, "--host 'base station'"),
        ({"key": Path("/k.pem")}, "--key is of no use without --certificate"),
        ({"certificate": Path("/etc/my keys/c.pem")}, "--certificate /etc/my keys/c.pem: it is an absolute path"),
        ({"certificate": Path("c.pem")}, "--certificate c.pem: it is an absolute path"),
        ({"certificate": Path("/c.pem"), "key": Path("/$HOME")}, "--key /$HOME"),
        ({"firewall": "wg robots"}, "--firewall 'wg robots'"),
        ({"firewall": ""}, "--firewall ''"),
        ({"firewall": "sixteen-letters-"}, "--firewall 'sixteen-letters-'"),
    ],
)
def test_what_no_service_could_use_is_refused_with_the_option_s_name(changes: dict[str, Any], output: str) -> None:
    with pytest.raises(ConfigurationError) as reported:
        check(dataclasses.replace(InstallSettings(), **changes))
    assert output in str(reported.value)
    assert "\n" not in str(reported.value)


@pytest.mark.parametrize(
    "changes",
    [
        {"domain": 101},
        {"domain": 215},
        {"domain": 232},
        {"port": 1024},
        {"port": 65535},
        {"address": "::1"},
        {"address": "base.example"},
        {"peers": ("r2d2", "robot-1.local", "10.42.0.11", "4robots")},
        {"firewall": "fifteen-letters"},
    ],
)
def test_what_is_fine_is_taken(changes: dict[str, Any]) -> None:
    check(dataclasses.replace(InstallSettings(), **changes))


def test_the_ports_of_a_domain_end_where_ports_end() -> None:
    # DDSI-RTPS 2.2, 9.6.1.1: PB = 7400, DG = 250.
    assert InstallSettings(domain=0).dds_ports == (7400, 7649)
    assert InstallSettings(domain=42).dds_ports == (17900, 18149)
    assert InstallSettings(domain=232).dds_ports == (65400, 65535)


def test_what_is_only_for_this_machine() -> None:
    assert all(
        InstallSettings(address=address).is_loopback for address in ("127.0.0.1", "127.9.9.9", "::1", "localhost")
    )
    assert not any(InstallSettings(address=address).is_loopback for address in ("0.0.0.0", "::", "base"))  # noqa: S104 - texts
