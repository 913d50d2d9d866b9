# SPDX-License-Identifier: MIT
from pathlib import Path

from tests.deploy.doctor.fake_machine import FakeMachine, workload


def test_files_are_read_below_the_root(tmp_path: Path) -> None:
    machine = FakeMachine(tmp_path).write({"/sys/a1/x": "one\n", "/sys/a2/x": "two\n\0", "/sys/b/x": "three"}).machine
    assert machine.read("/sys/a1/x") == "one"
    assert machine.read("/sys/c") is None
    assert machine.read("/sys/a1") is None
    assert machine.read_all("/sys/a*/x") == {"/sys/a1/x": "one", "/sys/a2/x": "two"}


def test_what_a_robot_needs(tmp_path: Path) -> None:
    assert workload(tmp_path).needs_socketcan
    assert workload(tmp_path, can={"interface": "socketcan"}).needs_socketcan
    assert not workload(tmp_path, can={"interface": "local"}).needs_socketcan
    assert not workload(tmp_path, "cart").needs_socketcan
    assert workload(tmp_path, "cart").hardware is None
    assert workload(tmp_path, None).hardware is None
