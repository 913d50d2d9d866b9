# SPDX-License-Identifier: MIT
"""The doctor where the kernel has CAN: a virtual interface is found, and told from a real one."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, Probes, System, Verdict
from segway_ecc.deploy.doctor.doctor import examine
from segway_ecc.deploy.doctor.hardware import check_can
from tests.deploy.doctor.fake_machine import by_name, workload

MS = 1_000_000


@pytest.fixture
def down() -> Iterator[str]:
    """An interface that is there and down."""
    subprocess.run(["ip", "link", "add", "dev", "vcan7", "type", "vcan"], check=True)  # noqa: S607 - the guest's own
    yield "vcan7"
    subprocess.run(["ip", "link", "del", "vcan7"], check=True)  # noqa: S607 - as above


def looked(channel: str) -> dict[str, Finding]:
    return by_name(list(check_can(System(Probes()), workload(Path("/run"), can={"channel": channel}))))


def test_the_whole_examination(tmp_path: Path) -> None:
    machine = System(Probes(measured_ns=50 * MS))
    found = by_name(examine(machine, workload(tmp_path, can={"interface": "socketcan", "channel": "vcan0"})))
    assert found["CAN in the kernel"].verdict is Verdict.GOOD
    assert found["CAN vcan0"].found == "up"
    assert found["CAN vcan0 kind"].found == "virtual (vcan)"
    assert found["kernel"].found.endswith("not PREEMPT_RT")
    assert found["real-time scheduling"].verdict is Verdict.GOOD
    assert not [name for name in found if name.startswith("check of")]


def test_an_interface_that_is_down(down: str) -> None:
    found = looked(down)["CAN vcan7"]
    assert (found.verdict, found.found) == (Verdict.BAD, "down")


def test_an_interface_that_is_not_there() -> None:
    found = looked("vcan9")["CAN vcan9"]
    assert found.verdict is Verdict.BAD
    assert found.found.startswith("not there; there is vcan0")
