# SPDX-License-Identifier: MIT
"""How an IMU is turned in the robot it is mounted on."""

from collections.abc import Sequence
from typing import Final, Literal

Axis = Literal["+x", "-x", "+y", "-y", "+z", "-z"]
"""An axis of the sensor, and its sense."""

_LETTERS: Final = "xyz"


Vector = tuple[float, float, float]
"""Components along three axes that form a right-handed frame."""


class Mounting:
    """Turns vectors between the frame of a sensor and the frame of the robot: x forward, y left, z up (REP-103)."""

    __slots__ = ("_terms",)

    def __init__(self, axes: Sequence[Axis]) -> None:
        """Describe a sensor by which of its axes the robot's x, y and z lie on; ValueError if not right-handed."""
        self._terms = [(_LETTERS.index(axis[1]), -1.0 if axis[0] == "-" else 1.0) for axis in axes]
        rows = [[sign * (place == column) for column in range(3)] for place, sign in self._terms]
        if len(rows) != len(_LETTERS) or _cross(rows[0], rows[1]) != rows[2]:
            raise ValueError(
                f"mounting {', '.join(axes)} is not right-handed: x turned by 90 degrees towards y must turn about z"
            )

    def to_robot(self, vector: Sequence[float]) -> Vector:
        """A vector in the sensor's frame, in the robot's."""
        (x, x_sign), (y, y_sign), (z, z_sign) = self._terms
        return x_sign * vector[x], y_sign * vector[y], z_sign * vector[z]

    def to_sensor(self, vector: Sequence[float]) -> Vector:
        """A vector in the robot's frame, in the sensor's."""
        turned = [0.0, 0.0, 0.0]
        for value, (place, sign) in zip(vector, self._terms, strict=True):
            turned[place] = sign * value
        return turned[0], turned[1], turned[2]


def _cross(a: Sequence[float], b: Sequence[float]) -> list[float]:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
