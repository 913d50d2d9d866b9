# SPDX-License-Identifier: MIT
"""Another host, made by the kernel, and set-points that come from it."""

import os
import subprocess

import pytest

from segway_ecc.hil.latency.measure import Where, measure, other_host, other_host_lacks
from segway_ecc.node.errors import ConfigurationError

pytestmark = [pytest.mark.namespaces, pytest.mark.ros, pytest.mark.real_time]


def namespaces() -> str:
    return subprocess.run(["ip", "netns", "list"], check=True, capture_output=True, text=True).stdout  # noqa: S607 - of this machine


def test_a_set_point_from_another_host_comes_to_the_motors() -> None:
    with other_host() as host:
        found = measure(Where.OTHER_HOST, trials=20, publisher=host.prefix, environment=host.environment)
    assert found.where == "other host"
    assert found.missed < 20
    assert str(os.getpid()) not in namespaces()


def test_one_that_cannot_be_had_is_reported_and_nothing_is_left() -> None:
    with (
        other_host(),
        pytest.raises(ConfigurationError, match="no other host to be had: ip netns add"),
        other_host(),
    ):
        pass
    assert str(os.getpid()) not in namespaces()


def test_what_lacks_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/nowhere")
    assert other_host_lacks() == "no ip command (sudo apt-get install iproute2)"
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    assert other_host_lacks() == "only root may make one (a network namespace)"
