# SPDX-License-Identifier: MIT
"""Every packaged robot has every check that fits what it measures, drives and publishes."""

import pytest

from segway_ecc.firmware_io.clock import RealClock
from segway_ecc.firmware_io.hardware import NoHardware
from segway_ecc.node.config import load_robot, packaged_robots
from segway_ecc.node.cycle.signals import ODOMETRY_SIGNALS, SETPOINT_SIGNALS
from segway_ecc.node.robot import Robot, build_robot
from segway_ecc.node.safety.settings import SafetySettings

OF_DRIVES = {
    "wheel_velocity_limit",
    "frozen_after_s",
    "velocity_consistency",
    "supply",
    "late_cycles_limit",
    "max_command",
    "command_slew",
    "oscillation",
}
OF_WHAT_DRIVES, OF_JOINTS = {"following_error"}, {"joint_limits"}
"""Of a robot that follows velocities, and of one whose joints go to angles."""
OF_AN_IMU = {"tilt_limit_rad", "tilt_rate_limit", "yaw_consistency", "runaway", "gravity", "posture", "checklist"} | {
    "residual"
}
"""The carts have none: they do not fall, and arm as soon as their drives do. `residual` warns only."""
OF_ALL = {"output_limits"}
NO_CHECK = {"imu_is_noisy"}
"""How a check is to be made."""


@pytest.fixture(params=packaged_robots())
def robot(request: pytest.FixtureRequest) -> Robot:
    return build_robot(load_robot(request.param), RealClock())


def safety_of(robot: Robot) -> SafetySettings:
    assert robot.file.safety is not None
    return robot.file.safety


def drives(robot: Robot) -> bool:
    """Whether it follows velocities."""
    return any(entry in SETPOINT_SIGNALS for entry in robot.file.wiring.values())


def test_every_setting_is_a_check_of_something() -> None:
    assert (
        set(SafetySettings.__struct_fields__) == OF_DRIVES | OF_WHAT_DRIVES | OF_JOINTS | OF_AN_IMU | OF_ALL | NO_CHECK
    )


def test_a_robot_has_every_check_of_what_it_has(robot: Robot) -> None:
    wanted = set(OF_ALL)
    if not isinstance(robot.hardware, NoHardware):
        wanted |= OF_DRIVES | (OF_WHAT_DRIVES if drives(robot) else OF_JOINTS)
        if len(set(robot.hardware.limits)) > 1:
            wanted -= {"max_command"}  # which is one for all
    if "imu.angular_velocity_x" in robot.hardware.signals:
        wanted |= OF_AN_IMU
    safety = safety_of(robot)
    assert sorted(name for name in wanted if getattr(safety, name) is None) == []


def test_everything_that_the_model_gives_has_a_limit(robot: Robot) -> None:
    limits = safety_of(robot).output_limits or {}
    turning = {"left.angle", "right.angle"}  # which go on for as long as the wheels turn
    assert set(limits) == set(robot.wiring.given) - turning
    assert not drives(robot) or set(ODOMETRY_SIGNALS) <= set(limits)


def test_a_share_of_the_deadlines_is_watched_too(robot: Robot) -> None:
    limit = safety_of(robot).late_cycles_limit
    if limit is None:
        assert isinstance(robot.hardware, NoHardware)
        return
    deadlines = limit.window_s / robot.model.step_size
    assert limit.in_window is not None
    assert limit.in_window <= 0.4 * deadlines + 1e-9, "a step longer than its period misses every second one"
    assert limit.in_a_row < deadlines


def test_commands_are_limited_to_no_more_than_the_drives_take_and_oscillation_lies_within(robot: Robot) -> None:
    safety, limits = safety_of(robot), robot.hardware.limits
    if not limits:
        return
    most = max(limits) if safety.max_command is None else safety.max_command
    assert safety.max_command is None or most <= min(limits)
    assert safety.oscillation is not None
    assert safety.oscillation.amplitude <= 0.4 * most
    assert safety.command_slew is not None
    assert safety.command_slew * robot.model.step_size <= 2.0 * most, "else it slows nothing down"


def test_what_the_model_may_give_is_not_less_than_what_may_leave(robot: Robot) -> None:
    safety = safety_of(robot)
    limits = safety.output_limits or {}
    for command, most in zip(robot.hardware.commands, robot.hardware.limits, strict=True):
        assert limits[command] >= (safety.max_command or most), "a command that is only limited is no fault"
