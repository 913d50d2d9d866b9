# SPDX-License-Identifier: MIT
"""Settings in a robot file for an ICM-42688-P behind a bridge."""

from segway_ecc.firmware_io.imus.settings import SerialImuSettings


class Icm42688BridgeSettings(SerialImuSettings, frozen=True, kw_only=True, tag="icm42688_bridge"):
    """The sensor behind a bridge that runs bridge.ino; see `SerialImuSettings`."""
