# SPDX-License-Identifier: MIT
"""A robot file's text with what was identified: the plant's parameters, and what follows from them elsewhere in it."""

import re
from collections.abc import Mapping
from typing import Final

from segway_ecc.node.config import RobotFile
from segway_ecc.node.documents import decode_yaml
from segway_ecc.node.errors import ConfigurationError

_SIMULATION: Final = re.compile(r"^simulation:[ \t]*(#.*)?\n((?:[ \t]+\S.*\n?)*)", re.MULTILINE)
_PARAMETERS: Final = re.compile(r"^  parameters:.*\n?(?:    .*\n?)*", re.MULTILINE)
_SAFETY: Final = re.compile(r"^safety:[ \t]*(#.*)?\n((?:[ \t]+\S.*\n|[ \t]*\n)*)", re.MULTILINE)
_IN_SAFETY: Final = {"WheelRadius": "wheel_radius", "Track": "track", "ImuHeight": "imu_height"}


def with_plant(text: str, parameters: Mapping[str, float]) -> str:
    """The text with other parameters of its plant; everything else stays as it is.

    Raises:
        ConfigurationError: The file is not laid out as the packaged ones are.
    """
    section = _SIMULATION.search(text)
    if section is None:
        raise ConfigurationError("the robot file has no block `simulation:`; lay it out as segway.yaml is")
    body = _PARAMETERS.sub("", section.group(2))
    body += "" if body.endswith("\n") else "\n"
    body += "  parameters:\n" + "".join(f"    {name}: {value!r}\n" for name, value in parameters.items())
    changed = text[: section.start(2)] + body + text[section.end(2) :]
    simulation = decode_yaml(changed, RobotFile, "the robot file with what was identified").simulation
    if simulation is None or simulation.parameters != dict(parameters):
        raise ConfigurationError(
            "the plant's parameters cannot be put into this robot file; lay its `simulation:` out as segway.yaml's is"
        )
    return changed


def with_safety(text: str, values: Mapping[str, float]) -> str:
    """The text with the wheels' radius, the track and the IMU's height as safety is to have them, where it has them."""
    section = _SAFETY.search(text)
    if section is None:
        return text
    body = section.group(2)
    for name, key in _IN_SAFETY.items():
        if name in values:
            body = re.sub(rf"\b{key}: *[-+.\deE]+", f"{key}: {values[name]!r}", body)
    return text[: section.start(2)] + body + text[section.end(2) :]


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
