# SPDX-License-Identifier: MIT
"""On the real machine; nothing is asserted about its speed."""

import subprocess
import sys
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Probes
from segway_ecc.firmware_io.links.can_interfaces import UNKNOWN
from segway_ecc.firmware_io.links.settings import SerialSettings
from segway_ecc.hil.rig.simulated_serial import PtyPort
from tests.fixtures.refusing import refusing

MS = 1_000_000
ASKS = "from segway_ecc.deploy.doctor.check import Probes\nProbes().ask_before_exit()"


def test_wake_ups_are_counted_and_progress_is_reported() -> None:
    reported: list[float] = []
    summary = Probes(reported.append, measured_ns=600 * MS).wake_ups(20 * MS)
    assert summary.count == 30
    assert 0.0 <= summary.p50_s <= summary.p99_s <= summary.max_s
    assert reported == pytest.approx([1 / 3, 2 / 3, 1.0])


def test_progress_is_reported_each_cycle_when_the_period_is_long() -> None:
    reported: list[float] = []
    Probes(reported.append, measured_ns=300 * MS).wake_ups(250 * MS)
    assert reported == [0.5, 1.0]


def test_writing_leaves_nothing_behind(tmp_path: Path) -> None:
    speed = Probes().write(tmp_path)
    assert speed.bytes_per_s > 0.0
    assert speed.slowest_s > 0.0
    assert speed.bytes_per_s * speed.slowest_s >= 4 * 1024 * 1024 / 8 * 0.999
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        Probes().write(tmp_path / "none")


def test_an_interface_that_is_not_there() -> None:
    assert Probes().interface("nosuchif0") == UNKNOWN


def test_a_port_that_is_not_there() -> None:
    with pytest.raises(OSError, match="No such file"):
        Probes().open_port(SerialSettings(port="/dev/no-such-port"))


def test_a_port_is_opened_and_closed(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "serial")
    try:
        for _ in range(2):  # exclusively, so the second time shows that it was closed
            Probes().open_port(SerialSettings(port=str(port.path)))
    finally:
        port.close()


def test_the_filter_of_exits_is_tried_and_does_not_stay() -> None:
    words = [sys.executable, "-P", "-c", f"{ASKS}\nProbes().ask_before_exit()"]
    assert subprocess.run(words, check=False, capture_output=True).returncode == 0
    refused = subprocess.run(refusing("EPERM", *words), check=False, capture_output=True, text=True)
    assert refused.stderr.splitlines()[-1] == "PermissionError: [Errno 1] Operation not permitted"
