# SPDX-License-Identifier: MIT
"""The doctor on a PREEMPT_RT kernel with real controllers: bit rate, restart, queue and state as the driver tells."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, Probes, System, Verdict
from segway_ecc.deploy.doctor.computer import check_kernel
from segway_ecc.deploy.doctor.hardware import check_can
from segway_ecc.deploy.doctor.services import check_privileges
from tests.deploy.doctor.fake_machine import by_name, workload

MACHINE = System(Probes())


def ip_link(*words: str) -> None:
    subprocess.run(["ip", "link", "set", "can1", *words], check=True)  # noqa: S607 - the guest's PATH is ours


def looked(channel: str, bitrate: int) -> dict[str, Finding]:
    return by_name(list(check_can(MACHINE, workload(Path("/run"), can={"channel": channel, "bitrate": bitrate}))))


@pytest.fixture
def other() -> Iterator[None]:
    """can1 as it was, after the test has set it otherwise."""
    ip_link("down")
    yield
    ip_link("down")
    ip_link("type", "can", "bitrate", "500000", "restart-ms", "100")
    ip_link("txqueuelen", "16")
    ip_link("up")


def test_the_kernel() -> None:
    found = by_name(list(check_kernel(MACHINE, workload(Path("/run")))))
    assert {each.verdict for each in found.values()} == {Verdict.GOOD}
    assert found["kernel"].found.endswith(", PREEMPT_RT")


def test_privileges_of_root() -> None:
    found = by_name(list(check_privileges(MACHINE, workload(Path("/run")))))
    assert found["real-time scheduling"].found == "SCHED_FIFO 50 granted to this user"
    assert found["memory lock"].found == "any amount for this user"


def test_an_interface_as_it_should_be() -> None:
    assert {name: (each.verdict, each.found) for name, each in looked("can0", 500_000).items()} == {
        "CAN can0": (Verdict.GOOD, "up, active"),
        "CAN can0 bit rate": (Verdict.GOOD, "500000 bit/s"),
        "CAN can0 restart": (Verdict.GOOD, "100 ms after bus-off"),
        "CAN can0 queue": (Verdict.GOOD, "16 frames"),
    }


def test_the_wrong_bit_rate() -> None:
    found = looked("can0", 250_000)["CAN can0 bit rate"]
    assert (found.verdict, found.found) == (Verdict.BAD, "500000 bit/s, the robot file has 250000")


@pytest.mark.usefixtures("other")
def test_an_interface_that_is_down_and_what_mends_it() -> None:
    ip_link("txqueuelen", "1000")
    ip_link("type", "can", "bitrate", "125000", "restart-ms", "0")
    found = looked("can1", 500_000)
    assert {name: each.verdict for name, each in found.items()} == {
        "CAN can1": Verdict.BAD,
        "CAN can1 bit rate": Verdict.BAD,
        "CAN can1 restart": Verdict.WARNING,
        "CAN can1 queue": Verdict.WARNING,
    }

    for command in found["CAN can1"].remedy.split("; "):
        subprocess.run(command.removeprefix("sudo ").split(), check=True)

    assert {each.verdict for each in looked("can1", 500_000).values()} == {Verdict.GOOD}
