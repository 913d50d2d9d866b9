"""Set-points from another host: a network namespace of its own, with its own addresses, at the other end of a wire."""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator

import pytest

from node.latency.measure import measure
from node.latency.result import Where
from tests.ros_domains import next_domain

pytestmark = [
    pytest.mark.proof,
    pytest.mark.ros,
    pytest.mark.timeout(300),
    pytest.mark.skipif(os.geteuid() != 0 or shutil.which("ip") is None, reason="makes namespaces: needs root and ip"),
]
TRIALS = 100


@pytest.fixture
def station() -> Iterator[list[str]]:
    """What begins a command line in the other host."""
    name, ours, theirs = f"ecc{os.getpid()}", f"eccr{os.getpid()}"[:15], f"eccs{os.getpid()}"[:15]
    inside = ["ip", "netns", "exec", name]
    try:
        for words in (
            ["ip", "netns", "add", name],
            ["ip", "link", "add", ours, "type", "veth", "peer", "name", theirs],
            ["ip", "link", "set", theirs, "netns", name],
            ["ip", "address", "add", "10.98.0.1/24", "dev", ours],
            ["ip", "link", "set", ours, "up"],
            [*inside, "ip", "address", "add", "10.98.0.2/24", "dev", theirs],
            [*inside, "ip", "link", "set", "lo", "up"],
            [*inside, "ip", "link", "set", theirs, "up"],
            [*inside, "ip", "route", "add", "224.0.0.0/4", "dev", theirs],
        ):
            subprocess.run(words, check=True)
        yield inside
    finally:
        for words in (["ip", "link", "delete", ours], ["ip", "netns", "delete", name]):
            subprocess.run(words, check=False)


def test_a_set_point_from_another_host_comes_to_the_motors(station: list[str]) -> None:
    """Printed, since it depends on the machine; what is asserted holds on any."""
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DOMAIN_ID": next_domain()}
    found = measure(Where.OTHER_HOST, trials=TRIALS, publisher=station, environment=environment)
    sys.stderr.write(f"{found.text()}\n")
    assert found.where == "other host"
    assert found.missed < TRIALS // 2
