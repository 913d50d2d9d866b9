# SPDX-License-Identifier: MIT
from collections.abc import Callable
from typing import Any

import msgspec
import pytest

from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings

Configure = Callable[..., OdriveSettings]


@pytest.fixture(scope="session")
def configure() -> Configure:
    """Settings with wheels on nodes 0 and 1, the right one reversed behind a gear, other values as given."""

    def settings(**changes: Any) -> OdriveSettings:
        left: dict[str, object] = {"node_id": 0, "axis": 0, "max_torque": 3.0, "torque_constant": 0.1}
        right = {**left, "node_id": 1, "axis": 1, "direction": -1, "gear_ratio": 2.0}
        described = {"type": "odrive", "firmware": "0.5", "axes": {"left": left, "right": right}, **changes}
        return msgspec.convert(described, OdriveSettings)

    return settings
