# SPDX-License-Identifier: MIT
"""ROS domains of a test run's own, so that tests side by side never hear each other."""

import itertools
import os
import zlib
from typing import Final

DOMAINS: Final = 101
"""Domains 1 to 101 have ports that Linux gives to nobody else by itself."""
_used: Final = itertools.count()


def next_domain() -> str:
    """A domain that no other worker of this run uses; other runs most likely have others."""
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
    share = DOMAINS // int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    run = zlib.crc32(os.environ.get("PYTEST_XDIST_TESTRUNUID", str(os.getpid())).encode())
    return str(1 + (run + worker * share + next(_used) % share) % DOMAINS)
