# SPDX-License-Identifier: MIT
"""How an IMU is really mounted, from what it measured while a person tilted and turned the robot as told.

Upright, an accelerometer feels +z; the nose tilted down takes from its x, the right side down adds to its y. A gyro
turns about +y, +x and +z in these movements (REP-103, right-hand rule). Each movement tells which axis of the sensor,
with which sign, lies on an axis of the robot.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

from segway_ecc.firmware_io.imus.mounting import Mounting

Vector = Sequence[float]
AXES: Final = "xyz"
_DOMINANT: Final = 0.8
"""Share of a vector's length that one axis has at least: within 37 degrees of it."""
_TURNS: Final[Mapping[tuple[str, ...], str]] = {
    ("+x", "+y", "+z"): "",
    ("+x", "-y", "-z"): "by 180 degrees about x",
    ("-x", "+y", "-z"): "by 180 degrees about y",
    ("-x", "-y", "+z"): "by 180 degrees about z",
    ("+x", "+z", "-y"): "by -90 degrees about x",
    ("+x", "-z", "+y"): "by 90 degrees about x",
    ("-z", "+y", "+x"): "by -90 degrees about y",
    ("+z", "+y", "-x"): "by 90 degrees about y",
    ("+y", "-x", "+z"): "by -90 degrees about z",
    ("-y", "+x", "+z"): "by 90 degrees about z",
}
"""Where the sensor's axes point in the robot whose x, y, z lie on these axes of the sensor."""


def length(vector: Vector) -> float:
    """Of a vector."""
    return math.hypot(*vector)


def difference(one: Vector, other: Vector) -> tuple[float, ...]:
    """The first less the other."""
    return tuple(a - b for a, b in zip(one, other, strict=True))


def angle_between(one: Vector, other: Vector) -> float:
    """Between two vectors that are not zero, rad."""
    product = math.fsum(a * b for a, b in zip(one, other, strict=True)) / (length(one) * length(other))
    return math.acos(min(max(product, -1.0), 1.0))


def axis_of(vector: Vector) -> str | None:
    """The axis of the sensor along which a vector lies, such as `-y`; None where it lies between axes, or is zero."""
    size = length(vector)
    if size == 0.0:
        return None
    place = max(range(3), key=lambda at: abs(vector[at]))
    if abs(vector[place]) < _DOMINANT * size:
        return None
    return f"{'-' if vector[place] < 0.0 else '+'}{AXES[place]}"


def accelerometer_axes(upright: Vector, forward: Vector, right: Vector) -> tuple[str | None, ...]:
    """The sensor's axes on the robot's x, y and z, by what was felt upright and in both tilts, m/s2.

    Of a tilt counts what is across to the upright feeling.
    """
    return (
        axis_of(_across(difference(upright, forward), upright)),
        axis_of(_across(difference(right, upright), upright)),
        axis_of(upright),
    )


def gyro_axes(forward: Vector, right: Vector, left: Vector) -> tuple[str | None, ...]:
    """The same, by the angles that the gyro turned through: tilted forward, to the right, and turned left, rad."""
    return axis_of(right), axis_of(forward), axis_of(left)


def _across(vector: Vector, along: Vector) -> tuple[float, ...]:
    share = math.fsum(a * b for a, b in zip(vector, along, strict=True)) / math.fsum(a * a for a in along)
    return tuple(a - share * b for a, b in zip(vector, along, strict=True))


def explain(found: Sequence[str | None], *, declared: Mounting | None) -> str:
    """What a mounting other than the declared one is, with the remedy.

    Args:
        found: The sensor's axes on the robot's x, y and z, as the robot file declares the sensor now.
        declared: The mounting in the robot file; None where its IMU has none there.
    """
    if None in found:
        return "the movements lie between the IMU's axes: it is mounted askew, or the robot was not moved as told"
    axes = tuple(axis for axis in found if axis is not None)
    turned = _TURNS.get(axes)
    try:
        mounting = Mounting(axes)  # type: ignore[arg-type]  # made of those letters above
    except ValueError:
        listed = ", ".join(f"{own} on {axis}" for own, axis in zip(AXES, axes, strict=True))
        return f"the IMU's axes are swapped or mirrored ({listed}): no mounting does that; see its driver and wiring"
    text = f"the IMU is turned {turned}" if turned else "the IMU is turned about a corner"
    if declared is None:
        return f"{text}: mount it with its x ahead, y to the left and z up"
    # What the robot calls its axes now lies on `axes` of what the declared mounting makes of the sensor.
    rows = [mounting.to_sensor([float(own == place) for place in range(3)]) for own in range(3)]
    names = [axis_of(declared.to_sensor(row)) for row in rows]
    return f"{text}: turn it, or set external_imu.mounting to [{', '.join(str(name) for name in names)}]"


def gyro_fault(gyro: Sequence[str | None], accelerometer: Sequence[str | None]) -> str | None:
    """What is wrong with a gyro whose axes are not those of its accelerometer; None where they are."""
    if tuple(gyro) == tuple(accelerometer) or None in gyro:
        return None
    reversed_axes = [
        own
        for own, one, other in zip(AXES, gyro, accelerometer, strict=True)
        if one and other and one[1] == other[1] and one != other
    ]
    same_letters = all(one and other and one[1] == other[1] for one, other in zip(gyro, accelerometer, strict=True))
    if same_letters:
        return f"the gyro's sign is reversed about {', '.join(reversed_axes)}, against its accelerometer"
    return "the gyro's axes are not those of its accelerometer"


def as_measured(prefix: str, vectors: Mapping[str, Vector], unit: str) -> dict[str, float]:
    """Vectors as numbers of a report, by name."""
    return {
        f"{prefix}_{name}_{axis}_{unit}": value
        for name, vector in vectors.items()
        for axis, value in zip(AXES, vector, strict=True)
    }
