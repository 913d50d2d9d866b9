# SPDX-License-Identifier: MIT
"""A drill that is killed leaves none of its processes behind, not even one that it had stopped."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.patience import PATIENCE_S

pytestmark = pytest.mark.real_time


def states(channel: str) -> dict[int, str]:
    """The state of each process that was told of a channel (proc(5)); the dead are left out."""
    found = {}
    for folder in Path("/proc").iterdir():
        if not folder.name.isdigit():
            continue
        try:
            words = (folder / "cmdline").read_bytes().split(b"\0")
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        if channel.encode() in words and state not in "ZX":
            found[int(folder.name)] = state
    return found


def test_a_drill_that_is_killed_ends_all_it_started(tmp_path: Path) -> None:
    channel = f"orphans_{os.getpid()}"
    # Again and again, so that it is seen stopped however slow the looking is.
    words = ["prove", "kill-drill", "--fault", "node stopped", "--repeat", "20", "--channel", channel]
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "segway_ecc.node.cli.main", *words],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "TMPDIR": str(tmp_path)},
    ) as drill:
        deadline = time.monotonic() + PATIENCE_S
        while "T" not in states(channel).values():
            assert drill.poll() is None
            assert time.monotonic() < deadline
        before = states(channel)
        drill.kill()
    assert len(before) == 4, "the drill, the plant, the guard and the node"
    deadline = time.monotonic() + PATIENCE_S
    while left := states(channel):
        assert time.monotonic() < deadline, left
        time.sleep(0.01)
