# SPDX-License-Identifier: MIT
"""What a log holds beside its messages: the names of what is in a cycle, and where the run comes from."""

import contextlib
import functools
import importlib
import math
import os
import re
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

import msgspec

from segway_ecc.node.cycle.signals import joint_signals

if TYPE_CHECKING:  # the process that writes needs no robot
    from segway_ecc.node.robot import Robot


ROBOT_FILE: Final = "robot.json"
"""The attachment that a replay builds the robot from: the robot file as it was in force, options included."""
ROBOT_TEXT: Final = "robot.yaml"
"""The attachment for people: the robot file as it was written."""
PART_FILE: Final = "part.json"
"""The attachment that holds which file of which run this is."""
END_FILE: Final = "end.json"
"""The attachment that the last file of a run has, and no file of a run whose node was killed."""
MODEL: Final = "model"
"""The metadata about the model: `source` and `sha256`."""
_LIBRARIES: Final = ("msgspec", "python-can", "mcap", "numpy", "pyserial")


class CycleLayout(msgspec.Struct, frozen=True, kw_only=True):
    """Names of everything a cycle holds, in the order it holds it.

    Attributes:
        sensors: Signals that the hardware measures.
        commands: What the hardware takes.
        limits: Largest magnitude of each command; None for any.
        odometry_frame: Frame of the pose.
        base_frame: Frame of the velocities.
        imu_frame: Frame of the IMU's values.
        joints: What ROS calls the joints that are published.
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
    joints: tuple[str, ...]
    period_ns: int = 0


class LogPart(msgspec.Struct, frozen=True):
    """Which file of a run a log is.

    Attributes:
        run: Identity of the run; no other has it.
        number: Of the file, from 1 on.
    """

    run: str = msgspec.field(default_factory=lambda: os.urandom(16).hex())
    number: int = 1


class LogEnd(msgspec.Struct, frozen=True):
    """What the last file of a run says at its end.

    Attributes:
        run: As in `LogPart`.
        number: Of the last file.
        last_cycle: Number of the run's last cycle; None where there was none, or where an older version wrote it.
    """

    run: str
    number: int
    last_cycle: int | None = None


class Provenance(msgspec.Struct, frozen=True):
    """What a log holds about the run beside its messages: texts by file name, and named texts by their group."""

    attachments: dict[str, str]
    metadata: dict[str, dict[str, str]]


NO_PROVENANCE: Final = Provenance({}, {})


@functools.cache  # a log in several files names what was there at its beginning
def surroundings() -> dict[str, dict[str, str]]:
    """The software and the machine; the process that writes a log asks for them, since that takes long."""
    machine = os.uname()
    library = importlib.import_module("importlib.metadata")
    versions = dict.fromkeys(("segway-ecc", *_LIBRARIES), "not installed")
    for name in versions:
        with contextlib.suppress(library.PackageNotFoundError):
            versions[name] = library.version(name)
    return {
        "software": versions,
        "machine": {
            "host": machine.nodename,
            "system": f"{machine.sysname} {machine.release} {machine.version}",
            "machine": machine.machine,
            "libc": os.confstr("CS_GNU_LIBC_VERSION") or "",
            "python": sys.version,
        },
    }


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
        joints=tuple(ros.joint_names(joint_signals(robot.wiring.published))),
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
