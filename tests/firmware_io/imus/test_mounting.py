# SPDX-License-Identifier: MIT
import itertools
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.imus.mounting import Axis, Mounting

AXES: tuple[Axis, ...] = get_args(Axis)
UNIT = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def matrix(axes: tuple[Axis, ...]) -> np.ndarray:
    return np.array([float(f"{axis[0]}1") * np.array(UNIT[axis[1]]) for axis in axes])


ALL = list(itertools.product(AXES, repeat=3))
ROTATIONS = [axes for axes in ALL if round(np.linalg.det(matrix(axes))) == 1]


def test_a_sensor_can_sit_in_24_ways() -> None:
    assert len(ROTATIONS) == 24


@pytest.mark.parametrize("axes", ROTATIONS, ids=" ".join)
def test_every_rotation_turns_as_its_matrix_does(axes: tuple[Axis, ...]) -> None:
    measured = (1.0, 20.0, 300.0)
    turned = Mounting(axes).to_robot(measured)
    assert turned == tuple(matrix(axes) @ measured)
    assert Mounting(axes).to_sensor(turned) == measured


@given(st.sampled_from([axes for axes in ALL if axes not in ROTATIONS]))
def test_what_is_no_rotation_is_refused(axes: tuple[Axis, ...]) -> None:
    with pytest.raises(ValueError, match=r"^mounting .., .., .. is not right-handed"):
        Mounting(axes)


@pytest.mark.parametrize("axes", [(), ("+x", "+y"), ("+x", "+y", "+z", "+x")])
def test_three_axes_are_needed(axes: tuple[Axis, ...]) -> None:
    with pytest.raises(ValueError, match="is not right-handed"):
        Mounting(axes)


def test_a_sensor_on_its_side_feels_gravity_where_it_is() -> None:
    # Connector up: the sensor's x points up, its z to the left; gravity's reaction is along its x.
    mounting = Mounting(("+y", "+z", "+x"))
    assert mounting.to_robot((9.81, 0.0, 0.0)) == (0.0, 0.0, 9.81)
