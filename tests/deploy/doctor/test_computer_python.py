# SPDX-License-Identifier: MIT
from segway_ecc.deploy.doctor.check import Verdict
from segway_ecc.deploy.doctor.computer import check_python
from tests.deploy.doctor.fake_machine import FakeMachine, workload


def test_a_release(fake: FakeMachine) -> None:
    (found,) = check_python(fake.machine, workload(fake.root))
    assert (found.verdict, found.found) == (Verdict.GOOD, "CPython 3.11.2")


def test_a_debug_build(fake: FakeMachine) -> None:
    fake.is_debug_python = True
    (found,) = check_python(fake.machine, workload(fake.root))
    assert (found.verdict, found.found) == (Verdict.WARNING, "CPython 3.11.2, a debug build")
