# SPDX-License-Identifier: MIT
"""From what was felt and turned to how an IMU is mounted."""

import itertools

import pytest

from segway_ecc.firmware_io.imus.mounting import Axis, Mounting
from segway_ecc.hil.commission.mounting import accelerometer_axes, axis_of, explain, gyro_axes, gyro_fault

Axes = tuple[Axis, Axis, Axis]
LETTERS: tuple[Axis, ...] = ("+x", "-x", "+y", "-y", "+z", "-z")
AS_DECLARED: Axes = ("+x", "+y", "+z")


def mountings() -> list[Axes]:
    """All 24 of them."""
    found: list[Axes] = []
    for axes in itertools.product(LETTERS, LETTERS, LETTERS):
        try:
            Mounting(axes)
        except ValueError:
            continue
        found.append(axes)
    return found


def felt(mounting: Mounting) -> tuple[tuple[str | None, ...], tuple[str | None, ...]]:
    """Axes by accelerometer and gyro of a sensor that is mounted so, tilted by 40 degrees and turned."""
    upright, forward, right = (0.0, 0.0, 9.8), (-6.3, 0.0, 7.5), (0.0, 6.3, 7.5)
    turns = (0.0, 0.7, 0.0), (0.7, 0.0, 0.0), (0.0, 0.0, 1.6)
    by_accelerometer = accelerometer_axes(*(mounting.to_sensor(vector) for vector in (upright, forward, right)))
    return by_accelerometer, gyro_axes(*(mounting.to_sensor(vector) for vector in turns))


def test_there_are_24_mountings() -> None:
    assert len(mountings()) == 24


@pytest.mark.parametrize("axes", mountings())
def test_every_mounting_is_found_and_what_is_advised_is_right(axes: Axes) -> None:
    by_accelerometer, by_gyro = felt(Mounting(axes))

    assert by_accelerometer == by_gyro == axes
    assert gyro_fault(by_gyro, by_accelerometer) is None
    if axes != AS_DECLARED:
        assert f"[{', '.join(axes)}]" in explain(axes, declared=Mounting(AS_DECLARED))


@pytest.mark.parametrize("declared", mountings()[::5])
@pytest.mark.parametrize("real", mountings()[::7])
def test_advice_holds_for_a_mounting_that_is_declared_wrongly(declared: Axes, real: Axes) -> None:
    robot_axes = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    names = [axis_of(Mounting(declared).to_robot(Mounting(real).to_sensor(axis))) for axis in robot_axes]

    assert f"[{', '.join(real)}]" in explain(names, declared=Mounting(declared))


def test_movement_between_axes_is_no_mounting() -> None:
    assert axis_of((0.7, 0.7, 0.0)) is None
    assert axis_of((0.0, 0.0, 0.0)) is None
    assert "askew" in explain((None, "+y", "+z"), declared=None)


def test_mirrored_axes_are_no_mounting() -> None:
    assert "mirrored" in explain(("-x", "+y", "+z"), declared=Mounting(AS_DECLARED))


def test_fixed_imu_is_to_be_turned() -> None:
    assert explain(("-x", "-y", "+z"), declared=None) == (
        "the IMU is turned by 180 degrees about z: mount it with its x ahead, y to the left and z up"
    )
