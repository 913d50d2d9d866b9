# SPDX-License-Identifier: MIT
"""Settings in a robot file for an IMU of its own: the parts that every one shares."""

from typing import Annotated

import msgspec

from segway_ecc.firmware_io.imus.mounting import Axis, Mounting
from segway_ecc.firmware_io.links.settings import PortSettings
from segway_ecc.firmware_io.value import Section


class ImuSettings(Section, frozen=True, kw_only=True):
    """An IMU on the drives' bus, or on a line of its own, whose tag is its name among those installed.

    Attributes:
        period_s: How often it sends a set of measurements, s.
        mounting: The axes of the sensor that point along the robot's x (forward), y (left) and z (up).
    """

    period_s: Annotated[float, msgspec.Meta(ge=0.001, le=0.1)] = 0.005
    mounting: tuple[Axis, Axis, Axis] = ("+x", "+y", "+z")

    def __post_init__(self) -> None:
        """Refuse a mounting that is no rotation."""
        Mounting(self.mounting)

    @property
    def rotation(self) -> Mounting:
        """The mounting as what turns vectors."""
        return Mounting(self.mounting)


class SerialImuSettings(ImuSettings, frozen=True, kw_only=True):
    """An IMU on a serial line of its own; see `ImuSettings`."""

    serial: PortSettings
