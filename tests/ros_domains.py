# SPDX-License-Identifier: MIT
"""ROS domains of a test's own, so that tests side by side never hear each other, of whatever run and user they are."""

import collections
import contextlib
import itertools
import os
import socket
import zlib
from typing import Final

DOMAINS: Final = 101
"""Domains 1 to 101 have ports that Linux gives to nobody else by itself."""
_KEPT: Final = 6
"""By each process; a test has two at most, and what is given back has been left by then."""
_held: Final = collections.deque[socket.socket]()
_next: Final = itertools.count(zlib.crc32(f"{os.environ.get('PYTEST_XDIST_TESTRUNUID')} {os.getpid()}".encode()))


def next_domain() -> str:
    """A domain that no other process of this machine has from here."""
    if len(_held) == _KEPT:
        _held.popleft().close()
    for _ in range(DOMAINS):
        domain = 1 + next(_next) % DOMAINS
        # A name in the kernel, which all users share, and which is free again when its process has ended.
        name = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            name.bind(f"\0segway-ecc test in ROS domain {domain}")
            _held.append(name)
            return str(domain)
        name.close()
    raise AssertionError(f"all {DOMAINS} ROS domains are in use")
