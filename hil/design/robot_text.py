# SPDX-License-Identifier: MIT
"""A robot file's text with other parameters of its model or of its plant; everything else stays as it is."""

import re
from collections.abc import Mapping
from typing import Final, Literal

from segway_ecc.node.config import decode_robot
from segway_ecc.node.errors import ConfigurationError

_DIGITS: Final = 6
"""Of a number that was worked out, in a robot file."""
_PARAMETERS: Final = re.compile(r"^  parameters:.*\n(?:    .*\n)*", re.MULTILINE)


def rounded(values: Mapping[str, float]) -> dict[str, float]:
    """Numbers that were worked out, as a robot file has them."""
    return {name: float(f"{value:.{_DIGITS}g}") for name, value in values.items()}


def with_parameters(text: str, block: Literal["model", "simulation"], parameters: Mapping[str, float]) -> str:
    """The text with these parameters in a block, in place of those that it has.

    Raises:
        ConfigurationError: The file is not laid out as the packaged ones are.
    """
    text += "" if text.endswith("\n") else "\n"
    section = re.search(rf"^{block}:[ \t]*(#.*)?\n((?:[ \t]+\S.*\n)*)", text, re.MULTILINE)
    if section is None:
        raise ConfigurationError(f"the robot file has no block `{block}:` of lines; lay it out as segway.yaml is")
    lines = "  parameters:\n" + "".join(f"    {name}: {value!r}\n" for name, value in parameters.items())
    body, count = _PARAMETERS.subn(lambda _: lines, section.group(2))
    changed = text[: section.start(2)] + (body if count else body + lines) + text[section.end(2) :]
    file = decode_robot(changed, "the robot file with other parameters")
    taken = file.model if block == "model" else file.simulation
    if taken is None or taken.parameters != dict(parameters):
        raise ConfigurationError(
            f"parameters cannot be put into this robot file; lay its `{block}:` out as segway.yaml's is"
        )
    return changed
