# SPDX-License-Identifier: MIT
import errno
import os

from segway_ecc.deploy.doctor.check import Verdict
from segway_ecc.deploy.doctor.computer import check_kernel
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, workload


def verdict(fake: FakeMachine, name: str, robot: str | None = "cart-can") -> tuple[Verdict, str]:
    found = by_name(list(check_kernel(fake.machine, workload(fake.root, robot))))[name]
    return found.verdict, found.found


def test_a_real_time_kernel(fake: FakeMachine) -> None:
    assert verdict(fake, "kernel") == (Verdict.GOOD, "6.1.0-40-rt-amd64, PREEMPT_RT")


def test_a_real_time_kernel_of_today_has_no_file_for_it(fake: FakeMachine) -> None:
    fake.remove("/sys/kernel/realtime")
    assert verdict(fake, "kernel")[0] is Verdict.GOOD


def test_the_file_is_enough(fake: FakeMachine) -> None:
    fake.write({"/proc/sys/kernel/version": "#1 SMP"})
    assert verdict(fake, "kernel")[0] is Verdict.GOOD


def test_any_other_kernel(fake: FakeMachine) -> None:
    fake.write({"/proc/sys/kernel/version": "#1 SMP PREEMPT_DYNAMIC @0", "/sys/kernel/realtime": "0"})
    fake.processor = "aarch64"
    found = by_name(list(check_kernel(fake.machine, workload(fake.root))))["kernel"]
    assert found.verdict is Verdict.WARNING
    assert found.found == "6.1.0-40-rt-amd64, not PREEMPT_RT"
    assert "sudo apt-get install linux-image-rt-arm64 " in found.remedy


def test_can_in_the_kernel(fake: FakeMachine) -> None:
    name = "CAN in the kernel"
    assert verdict(fake, name) == (Verdict.GOOD, "socket(AF_CAN) works")
    fake.probes.no_can = True
    refused = "socket(AF_CAN): Address family not supported by protocol"
    assert verdict(fake, name) == (Verdict.BAD, refused)
    assert verdict(fake, name, None) == (Verdict.WARNING, refused)
    assert verdict(fake, name, "cart") == (Verdict.GOOD, f"{refused}; this robot needs none")


def test_a_kernel_or_container_that_refuses_the_filter_is_warned_of(fake: FakeMachine) -> None:
    assert verdict(fake, "seccomp")[0] is Verdict.GOOD
    fake.probes.exit_filter_error = OSError(errno.EPERM, os.strerror(errno.EPERM))
    found = by_name(list(check_kernel(fake.machine, workload(fake.root))))["seccomp"]
    assert found.verdict is Verdict.WARNING
    assert found.found.endswith("does not have the model's watchdog asked: Operation not permitted")
    assert "guard and drives end the torque" in found.effect
