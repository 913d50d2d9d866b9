# SPDX-License-Identifier: MIT
"""What the cycles of one robot hold: the names, and the names of the fields that bear them in the log."""

import math
import re
from collections.abc import Iterable
from typing import TYPE_CHECKING

import msgspec

if TYPE_CHECKING:  # the process that writes needs no robot
    from segway_ecc.node.robot import Robot


class CycleLayout(msgspec.Struct, frozen=True, kw_only=True):
    """Names of everything a cycle holds, in the order it holds it.

    Attributes:
        robot: The robot's name.
        published: Signals that the robot publishes.
        sensors: Signals that the hardware measures.
        inputs: The model's inputs.
        outputs: The model's outputs.
        commands: What the hardware takes.
        limits: Largest magnitude of each command; None for any.
        odometry_frame: Frame of the pose.
        base_frame: Frame of the velocities.
        imu_frame: Frame of the IMU's values.
        joints: The left wheel's joint and the right one's.
        period_ns: Of the loop, ns.
    """

    robot: str
    published: tuple[str, ...]
    sensors: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    commands: tuple[str, ...]
    limits: tuple[float | None, ...] = ()
    odometry_frame: str
    base_frame: str
    imu_frame: str
    joints: tuple[str, str]
    period_ns: int = 0


def layout_of(robot: "Robot") -> CycleLayout:
    """The layout of a robot's cycles."""
    ros = robot.file.ros
    return CycleLayout(
        robot=robot.file.name,
        published=tuple(robot.wiring.published),
        sensors=tuple(robot.hardware.signals),
        inputs=tuple(v.name for v in robot.model.inputs),
        outputs=tuple(v.name for v in robot.model.outputs),
        commands=tuple(robot.hardware.commands),
        limits=tuple(limit if math.isfinite(limit) else None for limit in robot.hardware.limits),
        odometry_frame=ros.odometry_frame,
        base_frame=ros.base_frame,
        imu_frame=ros.imu_frame,
        joints=(ros.left_joint, ros.right_joint),
        period_ns=robot.period_ns,
    )


def field_names(names: Iterable[str]) -> tuple[str, ...]:
    """A field of a ROS 2 message for each name: `Left.WheelSpeed 1` is `left_wheel_speed_1`.

    Such names are lower-case letters, digits and single underscores, and begin with a letter (the ROS 2 interface
    definition). Names that would be the same get a number.
    """
    fields: dict[str, None] = {}
    for name in names:
        words = re.sub(r"([a-z0-9])([A-Z])|([A-Z])([A-Z][a-z])", r"\1\3_\2\4", name)
        plain = re.sub(r"[^a-z0-9]+", "_", words.lower()).strip("_") or "unnamed"
        first = plain if plain[0].isalpha() else f"n{plain}"
        field, count = first, 1
        while field in fields:
            count += 1
            field = f"{first}_{count}"
        fields[field] = None
    return tuple(fields)
