# SPDX-License-Identifier: MIT
import dataclasses
import errno
import os

import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict, WriteSpeed
from segway_ecc.deploy.doctor.computer import check_disk
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, workload


def looked(fake: FakeMachine, log_bytes: int = 1000) -> dict[str, Finding]:
    return by_name(list(check_disk(fake.machine, dataclasses.replace(workload(fake.root), log_bytes=log_bytes))))


def test_all_is_well_and_no_folder_is_made(fake: FakeMachine) -> None:
    found = looked(fake)
    assert {each.verdict for each in found.values()} == {Verdict.GOOD}
    assert found["disk space"].found.endswith(f" MB free for {fake.root}/var/log/segway-ecc")
    assert found["disk speed"].found == f"20.0 MB/s, slowest wait 20 ms, in {fake.root}"
    assert not (fake.root / "var").exists()


def test_the_folder_itself_is_tried_where_it_is_there(fake: FakeMachine) -> None:
    (fake.root / "var/log/segway-ecc").mkdir(parents=True)
    assert looked(fake)["disk speed"].found.endswith("/var/log/segway-ecc")


def test_too_little_free_space_is_warned(fake: FakeMachine) -> None:
    found = looked(fake, 10**18)["disk space"]
    assert found.verdict is Verdict.WARNING
    assert "--log-limit" in found.remedy


@pytest.mark.parametrize(
    ("speed", "verdict"),
    [
        (WriteSpeed(2.1e6, 0.9), Verdict.GOOD),
        (WriteSpeed(1.9e6, 0.1), Verdict.WARNING),
        (WriteSpeed(20e6, 1.1), Verdict.WARNING),
    ],
)
def test_speed(fake: FakeMachine, speed: WriteSpeed, verdict: Verdict) -> None:
    fake.probes.speed = speed
    assert looked(fake)["disk speed"].verdict is verdict


def test_a_folder_that_may_not_be_written(fake: FakeMachine) -> None:
    fake.probes.write_error = OSError(errno.EROFS, os.strerror(errno.EROFS))
    found = looked(fake)["disk speed"]
    assert (found.verdict, found.found) == (Verdict.WARNING, f"{fake.root} cannot be written: Read-only file system")
    assert f"sudo install -d -o $USER {fake.root}/var/log/segway-ecc" in found.remedy
