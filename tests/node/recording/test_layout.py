# SPDX-License-Identifier: MIT
"""Names of ports and signals as fields of a ROS 2 message."""

import re

from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.node.recording.layout import field_names

VALID = re.compile(r"^(?!.*__)(?!.*_$)[a-z][a-z0-9_]*$")
"""What the ROS 2 interface definition allows a field to be called."""


def test_names_are_written_as_ros_writes_them() -> None:
    names = (
        "LeftVelocity",
        "X",
        "imu.angular_velocity_x",
        "Sub\\port 1",
        "GyroZ",
        "LQRGain",
        "3rd",
        "_",
        "",
        "motor-2",
    )

    assert field_names(names) == (
        "left_velocity",
        "x",
        "imu_angular_velocity_x",
        "sub_port_1",
        "gyro_z",
        "lqr_gain",
        "n3rd",
        "unnamed",
        "unnamed_2",
        "motor_2",
    )


def test_names_that_would_be_the_same_get_a_number() -> None:
    assert field_names(("a.b", "a_b", "A B", "a_b_2")) == ("a_b", "a_b_2", "a_b_3", "a_b_2_2")


@given(st.lists(st.text(max_size=12), max_size=12))
def test_whatever_the_names_the_fields_are_valid_and_all_different(names: list[str]) -> None:
    fields = field_names(names)

    assert len(set(fields)) == len(names)
    assert all(VALID.fullmatch(field) for field in fields)
