# SPDX-License-Identifier: MIT
"""All checks on whole machines."""

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import pytest

from segway_ecc.deploy.doctor.check import Finding, System, Verdict, Workload, good, is_fit
from segway_ecc.deploy.doctor.doctor import CHECKS, examine
from segway_ecc.firmware_io.links.link import LinkState
from tests.deploy.doctor.fake_machine import GOOD_CAN, FakeMachine, by_name, container, raspberry_pi, workload


def not_good(findings: list[Finding]) -> dict[str, str]:
    return {name: str(each.verdict) for name, each in by_name(findings).items() if each.verdict is not Verdict.GOOD}


def test_a_robots_computer_as_it_should_be(fake: FakeMachine) -> None:
    findings = examine(fake.machine, workload(fake.root))
    assert not not_good(findings)
    assert is_fit(findings)
    assert list(by_name(findings)) == [
        "kernel",
        "CAN in the kernel",
        "seccomp",
        "CAN can0",
        "CAN can0 bit rate",
        "CAN can0 restart",
        "CAN can0 queue",
        "serial line",
        "drives' watchdogs",
        "robot file",
        "real-time scheduling",
        "memory lock",
        "real-time throttling",
        "processor idle states",
        "clock source",
        "processor governor",
        "processors",
        "timer slack",
        "wake-ups",
        "memory",
        "disk space",
        "disk speed",
        "Python",
        "ROS 2",
        "ROS domain",
        "ROS discovery",
        "time synchronisation",
        "segway-ecc-node.service",
        "segway-ecc-guard.service",
    ]


def test_a_container(tmp_path: Path) -> None:
    fake = container(tmp_path)
    findings = examine(fake.machine, workload(tmp_path))
    assert not_good(findings) == {
        "kernel": "warning",
        "CAN in the kernel": "bad",
        "CAN can0": "bad",
        "real-time scheduling": "bad",
        "memory lock": "warning",
        "ROS 2": "warning",
        "services": "warning",
    }
    assert not is_fit(findings)


def test_a_container_is_fit_for_a_robot_that_is_all_model(tmp_path: Path) -> None:
    fake = container(tmp_path)
    assert is_fit(examine(fake.machine, workload(tmp_path, "cart")))


@pytest.mark.parametrize(("throttled", "is_well"), [("0", True), ("50005", False)])
def test_a_raspberry_pi(tmp_path: Path, throttled: str, is_well: bool) -> None:  # noqa: FBT001 - a parameter
    fake = raspberry_pi(tmp_path, throttled)
    findings = examine(fake.machine, workload(tmp_path))
    assert not_good(findings) == ({} if is_well else {"Raspberry Pi power": "bad"})
    assert is_fit(findings) == is_well


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"is_up": False, "state": None}, "CAN can0"),
        ({"bitrate": 250_000}, "CAN can0 bit rate"),
        ({"state": LinkState.BUS_OFF}, "CAN can0"),
    ],
    ids=["down", "wrong bit rate", "bus-off"],
)
def test_a_bus_that_is_not_fit(fake: FakeMachine, change: dict[str, object], name: str) -> None:
    fake.interface("can0", dataclasses.replace(GOOD_CAN, **change))  # type: ignore[arg-type]
    findings = examine(fake.machine, workload(fake.root))
    assert not_good(findings) == {name: "bad"}
    assert not is_fit(findings)


def test_a_machine_of_which_nothing_is_known(tmp_path: Path) -> None:
    """No file at all: every check comes to an end by itself."""
    findings = examine(FakeMachine(tmp_path).machine, workload(tmp_path))
    assert not [finding for finding in findings if finding.name.startswith("check of")]


def _breaks(_machine: System, _workload: Workload) -> Iterator[Finding]:
    yield good("first half", "well")
    raise ZeroDivisionError("division by zero")


def test_broken_check_is_reported_and_the_others_run(fake: FakeMachine) -> None:
    checks = {"kernel": CHECKS["kernel"], "ours": _breaks, "python": CHECKS["python"]}
    found = by_name(examine(fake.machine, workload(fake.root), checks))
    assert list(found) == ["kernel", "CAN in the kernel", "seccomp", "first half", "check of ours", "Python"]
    assert found["check of ours"].verdict is Verdict.BAD
    assert found["check of ours"].found == "broke off: ZeroDivisionError: division by zero"


@pytest.mark.parametrize(
    ("path", "check"),
    [
        ("/sys/class/net/can0/flags", "can"),
        ("/proc/sys/kernel/sched_rt_runtime_us", "privileges"),
        ("/proc/self/timerslack_ns", "timing"),
        ("/proc/meminfo", "board"),
    ],
)
def test_a_file_of_nonsense_ends_one_check_at_most(fake: FakeMachine, path: str, check: str) -> None:
    fake.write({path: "MemAvailable: nonsense"})
    assert not_good(examine(fake.machine, workload(fake.root))) == {f"check of {check}": "bad"}
