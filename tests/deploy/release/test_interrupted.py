# SPDX-License-Identifier: MIT
"""What settles an update that a power cut interrupted."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.deploy.release.agent.journal import PENDING, Journal, Transaction
from segway_ecc.deploy.release.host import agent_archive
from tests.deploy.release.robot import LocalHost, Robot


@pytest.mark.variants(1)
@pytest.mark.parametrize("phase", ["switch", "restart", "trial", "back"])
def test_after_a_power_cut_the_boot_goes_back_before_anything_starts(
    robot: Robot, local: LocalHost, phase: str
) -> None:
    robot.push(local, "1.0")
    robot.push(local, "2.0")
    first, second = (manifest.name for manifest in robot.store.complete())
    Journal(robot.root).write(Transaction("push", second, first, "tester", "2026", phase=phase))
    calls = robot.calls()
    boot = [sys.executable, "-I", "-B", str(robot.root / "agent.pyz"), "settle", str(robot.root)]
    output = subprocess.check_output(boot, text=True)
    assert f'"current": "{first}"' in output
    assert robot.store.current() == first
    assert robot.calls() == calls, "at boot nothing is restarted: it has not been started yet"
    assert not (robot.root / PENDING).exists()
    last = robot.journal.last()
    assert last is not None
    assert last.outcome == ("went-back" if phase == "back" else "interrupted")
    assert subprocess.check_output(boot) == b"", "once is enough"
    robot.check_works()


def test_a_transaction_that_had_ended_is_only_put_away_at_boot(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    robot.push(local, "2.0")
    first, second = (manifest.name for manifest in robot.store.complete())
    robot.journal.write(Transaction("push", second, first, "tester", "2026", phase="end", outcome="healthy"))
    subprocess.run(
        [sys.executable, "-I", robot.root / "agent.pyz", "settle", robot.root], check=True, capture_output=True
    )
    assert robot.store.current() == second
    assert robot.journal.pending() is None


def test_the_archive_is_the_same_each_time_and_needs_the_standard_library_only(tmp_path: Path) -> None:
    assert agent_archive() == agent_archive()
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import segway_ecc.deploy.release.agent.main; print(*sys.modules)"
    )
    archive = tmp_path / "agent.pyz"
    archive.write_bytes(agent_archive())
    loaded = subprocess.check_output([sys.executable, "-I", "-S", "-c", code, archive], text=True).split()
    assert {name.partition(".")[0] for name in loaded} - set(sys.stdlib_module_names) - {"__main__"} == {"segway_ecc"}


def test_a_journal_that_a_newer_version_wrote_is_understood(robot: Robot, local: LocalHost) -> None:
    robot.push(local, "1.0")
    robot.push(local, "2.0")
    first, second = (manifest.name for manifest in robot.store.complete())
    robot.journal.write(Transaction("push", second, first, "tester", "2026", phase="trial"))
    path = robot.root / PENDING
    path.write_text(json.dumps(json.loads(path.read_text()) | {"novelty": 1}))
    assert robot.push(local, "3.0")["previous"] == first
    assert robot.journal.pending() is None
