# SPDX-License-Identifier: MIT
"""A robot's description as URDF, from the lengths in its file: for RViz, robot_state_publisher and who plans ways.

`base_link` is on the floor between the wheels, and stays level: what the odometry moves. A body that balances on them
leans in the model, and not in the description.
"""

import math
from collections.abc import Collection, Iterator
from typing import Final

from segway_ecc.node.config import RobotFile
from segway_ecc.node.cycle.signals import IMU_SIGNALS, joint_signals

_WHEEL_WIDTH: Final = 0.4
"""Of its radius: nothing depends on it, and no file has it."""
_NEXT_WHEEL: Final = 2.2
"""Radii to the next wheel of the same side; no file has that either."""
_BODY_WIDTH: Final = 0.7
"""Of the track."""


def urdf(file: RobotFile, published: Collection[str]) -> str:
    """The URDF of a robot that publishes these signals: its base, wheels and IMU, without inertias and meshes.

    Joints have the names of `joint_states`, and what is no wheel is left out. Empty where the file has no wheel radius
    or no track, or none of the axes is a wheel.
    """
    radius, track = file.geometry.wheel_radius, file.geometry.track
    signals = joint_signals(published)
    axes = [signal.rpartition(".")[0] for signal in signals[: len(signals) // 2]]
    names = dict(zip(axes, file.ros.joint_names(signals), strict=True))
    places = [(axis, x, side) for axis, x, side in _wheels(file) if axis in names]
    if radius is None or track is None or not places:
        return ""
    height = max(file.geometry.imu_height or 0.0, radius)
    body = f"{2 * radius:g} {_BODY_WIDTH * track:g} {height:g}"
    base = _escaped(file.ros.base_frame)
    parts = [_link(base, f'<box size="{body}"/>', f"0 0 {radius + height / 2:g}")]
    for axis, x, side in places:
        wheel = f'<cylinder radius="{radius:g}" length="{_WHEEL_WIDTH * radius:g}"/>'
        joint = _escaped(names[axis])
        link = f"{joint.removesuffix('_joint')}_link"
        where = f"{x * radius:g} {side * track / 2:g} {radius:g}"
        parts += [
            _link(link, wheel, "0 0 0", f"{math.pi / 2:.9g} 0 0"),
            _joint(joint, "continuous", (base, link), where, '<axis xyz="0 1 0"/>'),
        ]
    if file.geometry.imu_height is not None and all(signal in published for signal in IMU_SIGNALS):
        imu, where = _escaped(file.ros.imu_frame), f"0 0 {radius + file.geometry.imu_height:g}"
        parts += [f'<link name="{imu}"/>', _joint("imu_joint", "fixed", (base, imu), where)]
    return f'<?xml version="1.0"?>\n<robot name="{_escaped(file.name)}">\n' + "\n".join(parts) + "\n</robot>\n"


def _wheels(file: RobotFile) -> Iterator[tuple[str, float, float]]:
    """Axes that are wheels: where along x, in radii, and on which side, 1 for the left."""
    sides = [((mixing.left, mixing.right)) for mixing in file.mixing.values()] or [(("left",), ("right",))]
    for left, right in sides:
        for axes, side in ((left, 1.0), (right, -1.0)):
            for place, axis in enumerate(axes):
                yield axis, _NEXT_WHEEL * ((len(axes) - 1) / 2 - place), side


def _link(name: str, shape: str, where: str, turned: str = "0 0 0") -> str:
    inside = f'<origin xyz="{where}" rpy="{turned}"/><geometry>{shape}</geometry>'
    return f'<link name="{name}"><visual>{inside}</visual><collision>{inside}</collision></link>'


def _joint(name: str, kind: str, ends: tuple[str, str], where: str, axis: str = "") -> str:
    parent, child = ends
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{where}" rpy="0 0 0"/>{axis}</joint>'
    )


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
