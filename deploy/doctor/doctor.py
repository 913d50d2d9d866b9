# SPDX-License-Identifier: MIT
"""All checks, one after another; none can end the others."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final

from segway_ecc.deploy.doctor.check import Finding, System, Workload, bad
from segway_ecc.deploy.doctor.computer import (
    check_board,
    check_clock,
    check_disk,
    check_kernel,
    check_python,
    check_timing,
)
from segway_ecc.deploy.doctor.hardware import check_can, check_drives, check_serial
from segway_ecc.deploy.doctor.robot_file import check_robot_file
from segway_ecc.deploy.doctor.services import check_idle, check_privileges, check_ros, check_services

Check = Callable[[System, Workload], Iterable[Finding]]

CHECKS: Final[Mapping[str, Check]] = {
    "kernel": check_kernel,
    "can": check_can,
    "serial": check_serial,
    "drives": check_drives,
    "robot file": check_robot_file,
    "privileges": check_privileges,
    "idle": check_idle,
    "timing": check_timing,
    "board": check_board,
    "disk": check_disk,
    "python": check_python,
    "ros": check_ros,
    "clock": check_clock,
    "services": check_services,
}


def examine(machine: System, workload: Workload, checks: Mapping[str, Check] = CHECKS) -> list[Finding]:
    """Everything that the checks find, in their order; where one breaks, also what it had found until then."""
    findings: list[Finding] = []
    for name, check in checks.items():
        try:
            for finding in check(machine, workload):
                findings.append(finding)  # noqa: PERF402 - what came before it broke is kept
        except Exception as error:  # noqa: BLE001 - whatever it is, the other checks are still worth having
            findings.append(
                bad(
                    f"check of {name}",
                    f"broke off: {type(error).__name__}: {error}",
                    "what it did not get to is not known, and what is not known is not fit",
                    "report it with: segway-ecc log bundle",
                )
            )
    return findings
