# SPDX-License-Identifier: MIT
import errno
import os

import msgspec
import pytest

from segway_ecc.deploy.doctor.check import Finding, Verdict, Workload
from segway_ecc.deploy.doctor.hardware import check_can, check_serial
from segway_ecc.firmware_io.build import with_port
from tests.deploy.doctor.fake_machine import FakeMachine, by_name, workload


def with_serial(fake: FakeMachine, port: str) -> Workload:
    plain = workload(fake.root)
    assert plain.robot is not None
    assert plain.hardware is not None
    file = msgspec.structs.replace(plain.robot, hardware=with_port(plain.hardware, port))
    return Workload(plain.logs, plain.log_bytes, file, plain.period_ns)


def looked(fake: FakeMachine, port: str) -> dict[str, Finding]:
    return by_name(list(check_serial(fake.machine, with_serial(fake, port))))


@pytest.mark.parametrize("robot", ["cart-can", "cart", None])
def test_none_is_asked_for(fake: FakeMachine, robot: str | None) -> None:
    (found,) = check_serial(fake.machine, workload(fake.root, robot))
    assert (found.verdict, found.found) == (Verdict.GOOD, "none is asked for")
    assert not fake.probes.opened


def test_the_only_line_is_looked_at_and_without_it_the_drives_are_out_of_reach(fake: FakeMachine) -> None:
    plain = workload(fake.root, "cart-hoverboard")
    (found,) = check_can(fake.machine, plain)
    assert (found.verdict, found.found) == (Verdict.GOOD, "this robot's drives are on a serial line alone")
    assert not plain.needs_socketcan
    (found,) = check_serial(fake.machine, plain)
    assert (found.verdict, found.name) == (Verdict.GOOD, "serial /tmp/segway-hoverboard")
    fake.probes.port_error = OSError(errno.ENOENT, os.strerror(errno.ENOENT))
    (found,) = check_serial(fake.machine, plain)
    assert (found.verdict, found.effect) == (Verdict.BAD, "the drives are out of reach")


def test_the_line_of_an_imu_is_looked_at_beside_that_of_the_drives(fake: FakeMachine) -> None:
    plain = workload(fake.root, "segway-hoverboard")
    found = list(check_serial(fake.machine, plain))
    assert [(each.verdict, each.name) for each in found] == [
        (Verdict.GOOD, "serial /tmp/segway-hoverboard"),
        (Verdict.GOOD, "IMU serial /tmp/segway-imu"),
    ]
    assert [f"serial {port}" for port in fake.probes.opened] == [each.name.removeprefix("IMU ") for each in found]
    fake.probes.port_error = OSError(errno.ENOENT, os.strerror(errno.ENOENT))
    _, imu = check_serial(fake.machine, plain)
    assert (imu.verdict, imu.effect) == (Verdict.BAD, "the IMU is out of reach, and a robot that needs it does not arm")


def test_a_port_by_its_udev_name(fake: FakeMachine) -> None:
    found = looked(fake, "/dev/segway-serial")
    assert {name: each.verdict for name, each in found.items()} == {"serial /dev/segway-serial": Verdict.GOOD}
    assert fake.probes.opened == ["/dev/segway-serial"]


@pytest.mark.parametrize(
    ("number", "verdict", "remedy"),
    [
        (errno.ENOENT, Verdict.BAD, "plug it in"),
        (errno.EACCES, Verdict.BAD, "sudo usermod -aG dialout $USER"),
        (errno.EBUSY, Verdict.WARNING, "sudo fuser -v /dev/segway-serial"),
    ],
)
def test_a_port_that_does_not_open(fake: FakeMachine, number: int, verdict: Verdict, remedy: str) -> None:
    fake.probes.port_error = OSError(number, os.strerror(number))
    found = looked(fake, "/dev/segway-serial")["serial /dev/segway-serial"]
    assert found.verdict is verdict
    assert found.found == f"does not open: {os.strerror(number)}"
    assert remedy in found.remedy


@pytest.mark.parametrize("port", ["/dev/ttyUSB0", "/dev/ttyACM12"])
def test_a_name_that_may_be_another_ones_tomorrow(fake: FakeMachine, port: str) -> None:
    found = looked(fake, port)
    assert found[f"serial {port}"].verdict is Verdict.GOOD
    assert found[f"serial {port} name"].verdict is Verdict.WARNING
    assert "/dev/segway-serial" in found[f"serial {port} name"].remedy


@pytest.mark.parametrize("port", ["/dev/ttyAMA0", "/dev/serial/by-id/usb-FTDI", "socket://127.0.0.1:5000"])
def test_names_that_stay(fake: FakeMachine, port: str) -> None:
    assert list(looked(fake, port)) == [f"serial {port}"]
