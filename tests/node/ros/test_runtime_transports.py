# SPDX-License-Identifier: MIT
"""Our processes keep out of shared memory, and the user's own settings stay what they were."""

import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from segway_ecc.node.ros.runtime import (
    LOCALHOST_ONLY,
    PEERS,
    PROFILES,
    RANGE,
    RMW,
    TRANSPORTS,
    profiles_for,
    udp_only,
)
from tests.patience import PATIENCE_S
from tests.ros_domains import next_domain

XML = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"


def addresses(environment: dict[str, str]) -> list[str | None]:
    root = ET.fromstring(profiles_for(environment))  # noqa: S314 - our own text
    return [element.text for element in root.iter(f"{XML}address")]


def transports(environment: dict[str, str]) -> list[str | None]:
    root = ET.fromstring(profiles_for(environment))  # noqa: S314 - our own text
    return [element.text for element in root.iter(f"{XML}type")]


@pytest.mark.parametrize(
    ("environment", "asked"),
    [
        ({}, []),
        ({RANGE: "SUBNET", PEERS: "10.0.0.1"}, []),  # ROS adds those itself
        ({RANGE: "LOCALHOST"}, ["127.0.0.1"]),
        ({LOCALHOST_ONLY: "1"}, ["127.0.0.1"]),
        ({LOCALHOST_ONLY: "0"}, []),
        ({RANGE: "LOCALHOST", PEERS: "10.0.0.1; robot<&.local ;"}, ["127.0.0.1", "10.0.0.1", "robot<&.local"]),
    ],
)
def test_the_profile_has_udp_alone_and_asks_whom_the_user_named(environment: dict[str, str], asked: list[str]) -> None:
    assert transports(environment) == ["UDPv4"]
    assert addresses(environment) == asked


def test_the_environment_is_the_users_again_afterwards() -> None:
    environment = {RANGE: "LOCALHOST", "HOME": "/x"}
    with udp_only(environment):
        assert Path(environment[PROFILES]).read_text() == profiles_for({RANGE: "LOCALHOST"})
        assert environment[RANGE] == "SYSTEM_DEFAULT"
    assert environment == {RANGE: "LOCALHOST", "HOME": "/x"}


def test_the_deprecated_setting_is_taken_off_meanwhile() -> None:
    environment = {LOCALHOST_ONLY: "1"}
    with udp_only(environment):
        assert LOCALHOST_ONLY not in environment
        assert environment[RANGE] == "SYSTEM_DEFAULT"
    assert environment == {LOCALHOST_ONLY: "1"}


@pytest.mark.parametrize("name", [RANGE, "HOME"])
def test_elsewhere_discovery_stays_with_ros(name: str) -> None:
    environment = {name: "SUBNET"}
    with udp_only(environment):
        assert set(environment) == {name, PROFILES}
        assert environment[name] == "SUBNET"


@pytest.mark.parametrize("chosen", [{PROFILES: "mine.xml"}, {TRANSPORTS: "SHM"}, {RMW: "rmw_cyclonedds_cpp"}])
def test_what_the_user_chose_is_left_alone(chosen: dict[str, str]) -> None:
    environment = {RANGE: "LOCALHOST", **chosen}
    with udp_only(environment):
        assert environment == {RANGE: "LOCALHOST", **chosen}


def test_profiles_in_the_working_directory_are_left_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").touch()
    environment: dict[str, str] = {RMW: "rmw_fastrtps_cpp"}
    with udp_only(environment):
        assert PROFILES not in environment


@pytest.mark.ros
@pytest.mark.parametrize("settings", [{}, {RANGE: "LOCALHOST"}, {RANGE: "LOCALHOST", PEERS: "localhost"}])
def test_a_node_of_ours_maps_no_shared_memory(settings: dict[str, str], tmp_path: Path) -> None:
    code = (
        "from pathlib import Path\n"
        "from segway_ecc.node.ros.runtime import ros_node\n"
        "with ros_node('x', '', []): print(Path('/proc/self/maps').read_text().count('/dev/shm/fastrtps'), 'ports')"
    )
    unset = {PROFILES, TRANSPORTS, RANGE, PEERS, LOCALHOST_ONLY}
    inherited = {name: value for name, value in os.environ.items() if name not in unset}
    environment = inherited | settings | {"ROS_LOG_DIR": str(tmp_path), "ROS_DOMAIN_ID": next_domain()}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=PATIENCE_S, check=True
    )
    assert done.stdout == "0 ports\n"
    assert done.stderr == ""
