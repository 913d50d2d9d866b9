# SPDX-License-Identifier: MIT
"""A robot file's text with what follows from the plant's parameters elsewhere in it."""

import re
from collections.abc import Mapping
from typing import Final

from segway_ecc.hil.design.robot_text import rounded
from segway_ecc.node.config import RobotFile
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.models.segway_parameters import SegwayParameters

_SECTIONS: Final = re.compile(r"^(?:safety|geometry):[ \t]*(?:#.*)?\n(?:[ \t]+\S.*\n|[ \t]*\n)*", re.MULTILINE)


def with_safety(text: str, p: SegwayParameters) -> str:
    """The text with what geometry and safety are to know of the robot, where they have it.

    What stood beside a number that changes goes. Limits and tolerances stay.
    """
    known = rounded(_known_to_safety(p))

    def changed(section: re.Match[str]) -> str:
        body = section[0]
        for key, value in known.items():
            number = repr(value)
            body = re.sub(rf"\b{key}: *[-+.\deE]+", f"{key}: {number}", body)
            body = re.sub(rf"^( *{key}: {re.escape(number)}) *#.*$", r"\1", body, flags=re.MULTILINE)
        return body

    return _SECTIONS.sub(changed, text)


def _known_to_safety(p: SegwayParameters) -> Mapping[str, float]:
    """By the keys of `SafetySettings`."""
    return {
        "wheel_radius": p.wheel_radius,
        "track": p.track,
        "imu_height": p.imu_height,
        "mass": p.body_mass + 2.0 * (p.wheel_mass + p.wheel_inertia / p.wheel_radius**2),
        "moment": p.body_mass * p.body_height_of_centre,
        "coulomb_friction": p.coulomb_friction,
        "viscous_friction": p.viscous_friction,
        "resistance": p.motor_resistance,
        "constant": p.motor_constant * p.gear_ratio,
    }


def with_ranges(text: str, file: RobotFile, values: Mapping[str, float]) -> tuple[str, list[str]]:
    """The text with the ranges of `model.ranges` moved that hold a value no longer, and the names of those.

    A range keeps its width as a share of its middle.

    Raises:
        ConfigurationError: The file is not laid out as the packaged ones are.
    """
    moved = []
    for name, (low, high) in file.model.ranges.items():
        value = values.get(name)
        if value is None or ((low is None or low <= value) and (high is None or value <= high)):
            continue
        middle = sum(end for end in (low, high) if end is not None) / sum(end is not None for end in (low, high))
        ends = f"[{_moved(low, value / middle)}, {_moved(high, value / middle)}]"
        text, count = re.subn(rf"^(    {name}:) *\[[^\]]*\]", rf"\g<1> {ends}", text, count=1, flags=re.MULTILINE)
        if not count:
            raise ConfigurationError(
                f"model.ranges has {name} from {low} to {high}, and {value:g} was identified: change that range"
            )
        moved.append(f"{name} {ends}")
    return text, moved


def _moved(end: float | None, share: float) -> str:
    """An end of a range, as YAML; an open end stays open."""
    return "null" if end is None else repr(float(f"{end * share:.4g}"))
