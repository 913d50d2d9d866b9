# SPDX-License-Identifier: MIT
"""Settings in a robot file for CiA 402 drives."""

from typing import Annotated, Final

import msgspec

from segway_ecc.firmware_io.settings import Axes, BusSettings, WheelSettings, check_axes, check_unique

NodeId = Annotated[int, msgspec.Meta(ge=1, le=127)]
Units = Annotated[float, msgspec.Meta(gt=0.0, le=1e9)]

HEARTBEAT_PERIOD_MS: Final = 20
"""The drive's producer heartbeat time (0x1017), ms."""
ANSWER_WITHIN_NS: Final = 300_000_000
"""An SDO request that is not answered by then has failed."""


class Cia402WheelSettings(WheelSettings, frozen=True, kw_only=True):
    """One drive with its motor.

    Attributes:
        counts_per_turn: How far the position (0x6064) moves in one turn of the motor.
        velocity_units_per_turn: What the velocity (0x606C) reads at one turn of the motor a second, such as 60 for
            rpm; where left out, the counts of a turn.
    """

    node_id: NodeId
    counts_per_turn: Annotated[int, msgspec.Meta(ge=1, le=1 << 24)]
    velocity_units_per_turn: Units | None = None

    @property
    def velocity_unit_turns(self) -> float:
        """One unit of 0x606C, in turns of the motor a second."""
        return 1.0 / (self.velocity_units_per_turn or self.counts_per_turn)


class Cia402Settings(BusSettings, frozen=True, kw_only=True, tag="cia402"):
    """Drives of the CiA 402 profile over CANopen, which watch the heartbeat of the host under `host_node_id`."""

    host_node_id: NodeId = 127
    axes: Axes[Cia402WheelSettings]

    def __post_init__(self) -> None:
        """Refuse node ids that are not unique on the bus."""
        check_axes(self.axes)
        nodes = {name: wheel.node_id for name, wheel in self.axes.items()}
        check_unique("node_id", nodes)
        if self.host_node_id in nodes.values():
            raise ValueError(f"host_node_id is {self.host_node_id}, which is a drive's; it must be another one")
