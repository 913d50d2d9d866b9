# SPDX-License-Identifier: MIT
"""A robot with a wheel board, whose cycles hold something of everything."""

from collections.abc import Callable

import pytest

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.safety.modes import Mode

PERIOD_NS = 10_000_000
START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def layout() -> CycleLayout:
    return CycleLayout(
        robot="testbot",
        published=(
            "odometry.x",
            "odometry.y",
            "odometry.heading",
            "odometry.linear_velocity",
            "odometry.angular_velocity",
            "left.angle",
            "right.angle",
            "left.velocity",
            "right.velocity",
        ),
        sensors=("left.angle", "left.velocity"),
        inputs=("LeftVelocity",),
        outputs=("X", "Motor.Voltage", "Sub\\port 1"),
        commands=("left.voltage", "right.voltage"),
        limits=(24.0, None),
        odometry_frame="odom_frame",
        base_frame="base_frame",
        imu_frame="imu_link",
        joints=("left_joint", "right_joint"),
    )


@pytest.fixture
def record() -> Callable[[int], CycleRecord]:
    """Called with a cycle's number; every number in the record is another."""

    def of(cycle: int) -> CycleRecord:
        return CycleRecord(
            cycle,
            START_NS + cycle * PERIOD_NS,
            Mode.ARMED,
            lateness_ns=1_000,
            sensors=Sensors((1.5, 2.5), (0.001, 0.002), (True, True)),
            setpoint=Setpoint(0.5 + cycle, -0.25),
            u=(3.5,),
            y=(4.5, 5.5, 6.5),
            commands=(7.5, 8.5),
            published=(10.0, 11.0, 0.0, 12.0, 13.0, 14.0, 15.0, 16.0, 17.0),
            durations_ns=(1_000_000, 2_000_000, 3_000_000, 4_000_000, 5_000_000),
            start_ns=77,
        )

    return of
