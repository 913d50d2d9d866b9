# SPDX-License-Identifier: MIT
"""Settings in a robot file for moteus controllers."""

from typing import Annotated

import msgspec

from segway_ecc.firmware_io.settings import Axes, BusSettings, WheelSettings, check_axes, check_unique


class MoteusAxisSettings(WheelSettings, frozen=True, kw_only=True):
    """A controller and its motor; `servo_id` is its id.id: 0 and 126 are this computer's, 127 is everybody's."""

    servo_id: Annotated[int, msgspec.Meta(ge=1, le=125)]


class MoteusSettings(BusSettings, frozen=True, kw_only=True, tag="moteus"):
    """moteus controllers, by the names of their axes: the first one measures the supply."""

    axes: Axes[MoteusAxisSettings]

    def __post_init__(self) -> None:
        """Refuse a bus of classic CAN, and two controllers of one id; ValueError."""
        if not self.can.fd:
            raise ValueError("moteus is on CAN FD: can: {fd: true, bitrate: 1000000, data_bitrate: 5000000}")
        check_axes(self.axes)
        check_unique("servo_id", {name: axis.servo_id for name, axis in self.axes.items()})
