# SPDX-License-Identifier: MIT
from pathlib import Path

import pytest

from tests.deploy.doctor.fake_machine import FakeMachine, robot_computer


@pytest.fixture
def fake(tmp_path: Path) -> FakeMachine:
    """A robot's computer with everything as it should be, for a test to spoil."""
    return robot_computer(tmp_path)
