# SPDX-License-Identifier: MIT
"""Runs the files of tests/kernel/guest in user-mode Linux, all in one boot, and tells their results one by one."""

from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from segway_ecc.hil.kernels.guest import GuestResult, to_stdout
from segway_ecc.hil.kernels.uml import run_in_guest

ROOT = Path(__file__).parents[2]
GUEST = Path("tests/kernel/guest")
FILES = sorted(path.stem for path in (ROOT / GUEST).glob("test_*.py"))
BOOT_AND_TESTS_S = 840.0

pytestmark = pytest.mark.kernel


def run(command: Sequence[str], environment: dict[str, str], results: Path) -> GuestResult:
    return run_in_guest(
        command,
        cwd=ROOT,
        interfaces=("vcan0", "vcan1"),
        environment={**environment, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"},
        timeout_s=BOOT_AND_TESTS_S,
        on_output=to_stdout,
        results=results,
    )


@pytest.fixture(scope="module")
def check(check_in_guest: Callable[..., Callable[[str], None]]) -> Callable[[str], None]:
    return check_in_guest(GUEST, run)


@pytest.mark.parametrize("stem", FILES)
def test_file_passes_in_the_guest(stem: str, check: Callable[[str], None]) -> None:
    check(stem)
