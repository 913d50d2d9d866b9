# SPDX-License-Identifier: MIT
import os
import stat
from importlib import resources

import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict
from segway_ecc.deploy.doctor.services import RULE, check_idle
from tests.deploy.doctor.fake_machine import FakeMachine, workload

FILE = "/dev/cpu_dma_latency"
UNIT = "LoadState=loaded\nUser=segway\nSupplementaryGroups=dialout\nDevicePolicy=closed\n"
ALLOWED = f"{UNIT}DeviceAllow=char-ttyS rw\nDeviceAllow={FILE} w\n"
USERS = "root:x:0:0:root:/root:/bin/bash\nsegway:x:990:{}:segway-ecc:/var/lib/segway-ecc:/usr/sbin/nologin\n"


def looked(fake: FakeMachine) -> Finding:
    (found,) = check_idle(fake.machine, workload(fake.root))
    return found


@pytest.fixture
def device(fake: FakeMachine) -> FakeMachine:
    """A file of this test's own group, which is that of the service's user, and its unit may have it."""
    fake.write({FILE: "", "/etc/passwd": USERS.format(os.getegid()), "/etc/group": "root:x:0:\n"})
    (fake.root / FILE[1:]).chmod(0o660)
    return fake.systemd(node=ALLOWED)


def test_a_kernel_without_it(fake: FakeMachine) -> None:
    assert looked(fake).verdict is Verdict.GOOD
    assert looked(fake).found == f"this kernel has no {FILE}"


def test_the_services_user_may(device: FakeMachine) -> None:
    assert (looked(device).verdict, looked(device).found) == (Verdict.GOOD, f"segway-ecc-node.service may write {FILE}")


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664 & ~stat.S_IWGRP])
def test_a_mode_that_keeps_it_out(device: FakeMachine, mode: int) -> None:
    """As the kernel makes it, it is root's alone."""
    (device.root / FILE[1:]).chmod(mode)
    found = looked(device)
    assert (found.verdict, found.found) == (
        Verdict.WARNING,
        f"{FILE} is not writable for the user of segway-ecc-node.service",
    )
    assert RULE in found.remedy
    (device.root / FILE[1:]).chmod(0o606)
    assert looked(device).verdict is Verdict.GOOD, "everybody may"


def test_another_group(device: FakeMachine) -> None:
    device.write({"/etc/passwd": USERS.format(os.getegid() + 1)})
    assert looked(device).verdict is Verdict.WARNING
    for group in (f"latency:x:{os.getegid()}:other,segway", f"dialout:x:{os.getegid()}:"):
        device.write({"/etc/group": f"{group}\n"})
        assert looked(device).verdict is Verdict.GOOD, group
    device.write({"/etc/group": f"latency:x:{os.getegid()}:segwayfan\n"})
    assert looked(device).verdict is Verdict.WARNING


def test_a_unit_that_keeps_devices_from_it(device: FakeMachine) -> None:
    device.systemd(node=f"{UNIT}DeviceAllow=char-ttyS rw\n")
    found = looked(device)
    assert found.found == f"the unit of segway-ecc-node.service does not allow it {FILE}"
    assert found.remedy == f"DeviceAllow={FILE} w by: sudo systemctl edit segway-ecc-node.service"
    device.systemd(node=UNIT.replace("closed", "auto"))
    assert looked(device).verdict is Verdict.GOOD


def test_a_unit_of_root_needs_no_group(device: FakeMachine) -> None:
    (device.root / FILE[1:]).chmod(0o600)
    device.systemd(node=ALLOWED.replace("User=segway", "User="))
    assert looked(device).verdict is Verdict.GOOD


def test_without_a_unit_it_is_this_user_who_counts(device: FakeMachine, monkeypatch: pytest.MonkeyPatch) -> None:
    del device.answers["segway-ecc-node"]
    assert looked(device).found == f"this user may write {FILE}"
    monkeypatch.setattr("os.access", lambda _path, _mode: False)  # root may whatever the mode is
    found = looked(device)
    assert found.found == f"{FILE} is not writable for this user"
    assert "sudo usermod -aG segway $USER" in found.remedy


def test_the_rule_is_the_one_that_is_shipped() -> None:
    shipped = (resources.files("segway_ecc.deploy") / "udev" / "70-segway-latency.rules").read_text("utf-8")
    assert RULE in shipped.splitlines()
