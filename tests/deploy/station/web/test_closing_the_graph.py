# SPDX-License-Identifier: MIT
"""The settings that are shipped for closing the ROS graph: each can be parsed, and they agree with each other."""

import configparser
import ipaddress
import os
import re
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

FOLDER = Path(__file__).parents[4] / "deploy" / "station" / "installer"
XML = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
RANGES = {"SUBNET", "LOCALHOST", "OFF", "SYSTEM_DEFAULT"}
KNOWN = {
    "ROS_DOMAIN_ID",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
    "ROS_STATIC_PEERS",
    "ROS_DISCOVERY_SERVER",
    "FASTRTPS_DEFAULT_PROFILES_FILE",
}
NETWORK = ipaddress.ip_network("10.42.0.0/24")


def env(name: str) -> dict[str, str]:
    """As a shell reads it, and systemd's EnvironmentFile."""
    words = shlex.split((FOLDER / name).read_text(), comments=True)
    return {key: value for key, _, value in (word.partition("=") for word in words)}


@pytest.mark.parametrize("name", ["localhost.env", "static-peers.env", "discovery-server.env"])
def test_environments_name_what_ros_knows(name: str) -> None:
    found = env(name)
    assert set(found) <= KNOWN
    assert found["ROS_DOMAIN_ID"] == "42"
    assert found.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST") in RANGES


def test_peers_are_inside_the_private_network_and_not_ignored() -> None:
    found = env("static-peers.env")
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"  # with OFF, ROS ignores the peers
    peers = [ipaddress.ip_address(peer) for peer in found["ROS_STATIC_PEERS"].split(";")]
    assert len(peers) == 3
    assert all(peer in NETWORK for peer in peers)
    assert set(wireguard_addresses()) == {str(peer) for peer in peers}
    assert Path(found["FASTRTPS_DEFAULT_PROFILES_FILE"]).name in {path.name for path in FOLDER.iterdir()}


def wireguard_addresses() -> list[str]:
    sections = re.split(r"(?=^\[)", (FOLDER / "base-station-wg.conf").read_text(), flags=re.MULTILINE)[1:]
    found = []
    for section in sections:
        parser = configparser.ConfigParser()
        parser.read_string(section)
        (name,) = parser.sections()
        key = {"Interface": "Address", "Peer": "AllowedIPs"}[name]
        found.append(parser[name][key].split("/")[0])
        assert "<" in parser[name].get("PrivateKey", parser[name].get("PublicKey", ""))  # no key is shipped
    return found


def test_the_firewall_closes_the_ports_of_that_domain_and_of_the_page() -> None:
    text = (FOLDER / "base-station.nft").read_text()
    first = 7400 + 250 * int(env("localhost.env")["ROS_DOMAIN_ID"])
    assert f"define dds_ports = {first}-{first + 249}" in text
    assert "define page_port = 8700" in text
    server = env("discovery-server.env")["ROS_DISCOVERY_SERVER"]
    assert f"define discovery_server_port = {server.rpartition(':')[2]}" in text
    assert text.count("{") == text.count("}")
    used = set(re.findall(r"\$(\w+)", text))
    assert used == set(re.findall(r"define (\w+) =", text))
    rules = [line.strip() for line in text.splitlines()]
    for ports in ("udp dport { $dds_ports, $discovery_server_port }", "tcp dport $page_port"):
        allowed, dropped = rules.index(f'iifname "wg-robots" {ports} accept'), rules.index(f"{ports} counter drop")
        assert allowed < dropped


def test_the_profile_is_the_default_one_and_speaks_through_what_it_names() -> None:
    root = ET.parse(FOLDER / "fastdds-one-interface.xml").getroot()  # noqa: S314 - our own file
    (transport,) = root.iter(f"{XML}transport_descriptor")
    addresses = [element.text for element in transport.iter(f"{XML}address")]
    assert addresses == ["127.0.0.1", "10.42.0.1"]
    (participant,) = root.iter(f"{XML}participant")
    assert participant.get("is_default_profile") == "true"
    used = participant.find(f"{XML}rtps/{XML}userTransports/{XML}transport_id")
    named = transport.find(f"{XML}transport_id")
    assert used is not None
    assert named is not None
    assert used.text == named.text
    builtin = participant.find(f"{XML}rtps/{XML}useBuiltinTransports")
    assert builtin is not None
    assert builtin.text == "false"


@pytest.mark.ros
def test_fast_dds_takes_the_profile(tmp_path: Path) -> None:
    code = "from segway_ecc.node.ros.runtime import ros_node\nwith ros_node('x', '', []): print('open')"
    for content, complains in ((None, False), ("<profiles><nonsense/></profiles>", True)):
        path = FOLDER / "fastdds-one-interface.xml"
        if content is not None:
            path = tmp_path / "bad.xml"
            path.write_text(content)
        environment = os.environ | {"FASTRTPS_DEFAULT_PROFILES_FILE": str(path), "ROS_LOG_DIR": str(tmp_path)}
        done = subprocess.run(
            [sys.executable, "-c", code],
            env=environment,
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            check=False,
        )
        assert "open" in done.stdout
        assert ("XMLPARSER" in done.stdout + done.stderr) == complains, done.stderr
