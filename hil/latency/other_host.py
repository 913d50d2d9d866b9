# SPDX-License-Identifier: MIT
"""Another host for as long as a measurement lasts: a network namespace at the other end of a wire of its own."""

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

from segway_ecc.node.errors import ConfigurationError

_HERE: Final = "198.18.98.1"
_THERE: Final = "198.18.98.2"
"""Of the addresses for benchmarks (RFC 2544), which no network has in use."""


class OtherHost(NamedTuple):
    """How to run a program there: what begins its command line, and an environment.

    With that it and whoever is here find each other in ROS, and nobody else.
    """

    prefix: Sequence[str]
    environment: Mapping[str, str]


def missing() -> str | None:
    """What it takes and is not here; None where nothing lacks."""
    if os.geteuid() != 0:
        return "only root may make one (a network namespace)"
    return None if shutil.which("ip") else "no ip command (sudo apt-get install iproute2)"


@contextlib.contextmanager
def other_host() -> Iterator[OtherHost]:
    """Have one while the context lasts.

    Raises:
        ConfigurationError: The kernel does not make one.
    """
    name, ours, theirs = f"ecc{os.getpid()}", f"eccr{os.getpid()}", f"eccs{os.getpid()}"
    inside = ["ip", "netns", "exec", name]
    peers = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_STATIC_PEERS": f"{_HERE};{_THERE}"}
    with contextlib.ExitStack() as stack:
        stack.callback(_run, ["ip", "netns", "delete", name])
        stack.callback(_run, ["ip", "link", "delete", ours])
        for words in (
            ["ip", "netns", "add", name],
            ["ip", "link", "add", ours, "type", "veth", "peer", "name", theirs],
            ["ip", "link", "set", theirs, "netns", name],
            ["ip", "address", "add", f"{_HERE}/30", "dev", ours],
            ["ip", "link", "set", ours, "up"],
            [*inside, "ip", "address", "add", f"{_THERE}/30", "dev", theirs],
            [*inside, "ip", "link", "set", "lo", "up"],
            [*inside, "ip", "link", "set", theirs, "up"],
        ):
            done = _run(words)
            if done.returncode != 0:
                raise ConfigurationError(f"no other host to be had: {' '.join(words)}: {done.stderr.strip()}")
        yield OtherHost(inside, peers)


def _run(words: Sequence[str]) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(words, capture_output=True, text=True, check=False)  # noqa: S603 - no shell reads our words
