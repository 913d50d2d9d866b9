# SPDX-License-Identifier: MIT
import re
from typing import get_args

import msgspec
import pytest

from segway_ecc.node.config import decode_robot
from segway_ecc.node.cycle.mixing import GeometrySection
from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.settings import (
    NOTHING_WATCHED,
    SHARED_LENGTHS,
    ChecklistSettings,
    FollowingErrorSettings,
    GravitySettings,
    JointLimits,
    LateCyclesLimit,
    MotorSettings,
    OscillationLimit,
    PostureSettings,
    ResidualSettings,
    RunawaySettings,
    SafetySettings,
    StationSettings,
    SupplyWindow,
    VelocityConsistency,
    YawConsistency,
)

BASE = "name: cart\nmodel: {source: 'segway_ecc.node.models.cart:Cart'}\nwiring: {}\n"
FULL = """
safety:
  tilt_limit_rad: 0.6
  tilt_rate_limit: 6.0
  wheel_velocity_limit: 40.0
  frozen_after_s: 0.2
  imu_is_noisy: false
  yaw_consistency: {track: 0.5, wheel_radius: 0.1, tolerance_rad_s: 0.5, for_s: 0.3}
  velocity_consistency: {tolerance_rad_s: 1.0, for_s: 0.2}
  following_error:
    {track: 0.4, wheel_radius: 0.2, linear_window: 0.6, angular_window: 0.7, settle_s: 2.0, for_s: 0.4, may_rest: true}
  supply: {min_v: 22.0, max_v: 29.4}
  late_cycles_limit: {in_a_row: 4, in_window: 20, window_s: 2.0}
  max_command: 3.0
  command_slew: 60.0
  output_limits: {odometry.x: 1000.0, left.torque: 4.0}
  oscillation: {amplitude: 2.0, in_window: 5, window_s: 0.3}
  gravity: {wheel_radius: 0.1, imu_height: -0.2, velocity_m_s: 1.5, gyro_rad_s: 0.2, settle_s: 0.7, spin_s: 0.2}
  checklist:
    {rate_tolerance: 0.1, still_rate: 0.2, still_acceleration: 1.0, still_s: 1.0, tilt_rad: 0.1, wheel_velocity: 1.0}
"""

# The least that each part is given.
PARTS: dict[type[msgspec.Struct], dict[str, float]] = {
    YawConsistency: {"track": 1.0, "wheel_radius": 1.0, "tolerance_rad_s": 1.0},
    VelocityConsistency: {"tolerance_rad_s": 1.0},
    FollowingErrorSettings: {"track": 1.0, "wheel_radius": 1.0, "linear_window": 1.0},
    SupplyWindow: {"min_v": 1.0, "max_v": 2.0},
    JointLimits: {"min_rad": 1.0, "max_rad": 2.0},
    LateCyclesLimit: {},
    RunawaySettings: {"wheel_radius": 1.0, "distance_m": 1.0},
    GravitySettings: {"wheel_radius": 1.0, "imu_height": 1.0, "velocity_m_s": 1.0, "gyro_rad_s": 1.0},
    MotorSettings: {"resistance": 1.0, "constant": 1.0},
    ResidualSettings: {
        "wheel_radius": 1.0,
        "imu_height": 1.0,
        "mass": 1.0,
        "moment": 1.0,
        "payload_kg": 1.0,
        "slope_rad": 1.0,
        "friction_n_m": 1.0,
        "radius_share": 1.0,
    },
    PostureSettings: {"down_rad": 1.0},
    OscillationLimit: {"amplitude": 1.0, "in_window": 2},
    ChecklistSettings: {},
    SafetySettings: {},
    StationSettings: {},
}


def decode(text: str) -> SafetySettings | None:
    return decode_robot(BASE + text, "robot.yaml").safety


def test_a_file_without_the_section_has_none() -> None:
    assert decode("") is None
    assert SafetySettings(frozen_after_s=None) == NOTHING_WATCHED


def test_every_key_is_taken() -> None:
    assert decode(FULL) == SafetySettings(
        tilt_limit_rad=0.6,
        tilt_rate_limit=6.0,
        wheel_velocity_limit=40.0,
        frozen_after_s=0.2,
        imu_is_noisy=False,
        yaw_consistency=YawConsistency(track=0.5, wheel_radius=0.1, tolerance_rad_s=0.5, for_s=0.3),
        velocity_consistency=VelocityConsistency(tolerance_rad_s=1.0, for_s=0.2),
        following_error=FollowingErrorSettings(
            track=0.4,
            wheel_radius=0.2,
            linear_window=0.6,
            angular_window=0.7,
            settle_s=2.0,
            for_s=0.4,
            may_rest=True,
        ),
        supply=SupplyWindow(min_v=22.0, max_v=29.4),
        late_cycles_limit=LateCyclesLimit(in_a_row=4, in_window=20, window_s=2.0),
        max_command=3.0,
        command_slew=60.0,
        output_limits={"odometry.x": 1000.0, "left.torque": 4.0},
        oscillation=OscillationLimit(amplitude=2.0, in_window=5, window_s=0.3),
        gravity=GravitySettings(
            wheel_radius=0.1, imu_height=-0.2, velocity_m_s=1.5, gyro_rad_s=0.2, settle_s=0.7, spin_s=0.2
        ),
        checklist=ChecklistSettings(
            rate_tolerance=0.1, still_rate=0.2, still_acceleration=1.0, still_s=1.0, tilt_rad=0.1, wheel_velocity=1.0
        ),
    )


def test_of_an_empty_section_only_the_watch_for_frozen_sensors_is_on() -> None:
    settings = decode("safety: {}")
    assert settings is not None
    on = {name: value for name, value in msgspec.structs.asdict(settings).items() if value is not None}
    assert on == {"frozen_after_s": 0.1, "imu_is_noisy": True}


def test_what_the_parts_leave_out_has_its_default() -> None:
    assert YawConsistency(track=1.0, wheel_radius=1.0, tolerance_rad_s=1.0).for_s == 0.2
    assert VelocityConsistency(tolerance_rad_s=1.0).for_s == 0.1
    assert FollowingErrorSettings(track=1.0, wheel_radius=1.0, linear_window=1.0) == FollowingErrorSettings(
        track=1.0, wheel_radius=1.0, linear_window=1.0, angular_window=None, settle_s=1.0, for_s=0.1, may_rest=False
    )
    assert OscillationLimit(amplitude=1.0, in_window=3).window_s == 0.2
    gravity = GravitySettings(wheel_radius=1.0, imu_height=1.0, velocity_m_s=1.0, gyro_rad_s=1.0)
    assert (gravity.settle_s, gravity.spin_s) == (0.4, None)
    assert RunawaySettings(wheel_radius=1.0, distance_m=1.0) == RunawaySettings(
        wheel_radius=1.0, linear_window=0.3, distance_m=1.0, settle_s=1.5
    )
    assert PostureSettings(down_rad=0.4) == PostureSettings(
        stand="stand", up_rad=0.2, down_rad=0.4, fall_s=0.5, stand_up_s=5.0, sit_down_s=5.0
    )
    left_out = {"coulomb_friction": 0.0, "viscous_friction": 0.0, "motor": None, "delay_s": 0.01}
    residual = msgspec.convert(PARTS[ResidualSettings], ResidualSettings)
    assert msgspec.structs.asdict(residual) == PARTS[ResidualSettings] | left_out | {
        "payload_height": None,
        "for_s": 1.0,
    }
    assert LateCyclesLimit() == LateCyclesLimit(in_a_row=5, in_window=None, window_s=1.0)
    assert ChecklistSettings() == ChecklistSettings(
        rate_tolerance=0.05, still_rate=0.1, still_acceleration=0.5, still_s=0.5, tilt_rad=0.2, wheel_velocity=0.5
    )


GIVE_WINDOW = "give linear_window (m/s), angular_window (rad/s) or both at safety.following_error"
GRAVITY = "gravity: {wheel_radius: 0.1, velocity_m_s: 1.0, gyro_rad_s: 0.1, "
REFUSED = {
    "posture: {up_rad: 0.3, down_rad: 0.3}": "up_rad 0.3 is not below down_rad 0.3 at safety.posture",
    "posture: {up_rad: 0.5, down_rad: 0.4}": "up_rad 0.5 is not below down_rad 0.4 at safety.posture",
    "posture: {}": "down_rad",
    "joint_limits: {arm: {min_rad: 1, max_rad: 1}}": "min_rad 1 is not below max_rad 1 at safety.joint_limits",
    GRAVITY + "imu_height: 3.1}": "safety.gravity.imu_height",
    GRAVITY + "imu_height: -3.1}": "safety.gravity.imu_height",
    GRAVITY + "imu_height: 0.5, settle_s: 0.09}": "safety.gravity.settle_s",
    GRAVITY + "imu_height: 0.5, settle_s: 11.0}": "safety.gravity.settle_s",
    "tilt_limit_rad: 1.6": "safety.tilt_limit_rad",
    "tilt_limit_rad: 0.0": "safety.tilt_limit_rad",
    "tilt_rate_limit: -1.0": "safety.tilt_rate_limit",
    "command_slew: 0.0": "safety.command_slew",
    "max_command: 1000001.0": "safety.max_command",
    "frozen_after_s: 0.009": "safety.frozen_after_s",
    "frozen_after_s: 10.1": "safety.frozen_after_s",
    "supply: {min_v: 29.0, max_v: 29.0}": "min_v 29 is not below max_v 29",
    "late_cycles_limit: {in_a_row: 0}": "safety.late_cycles_limit.in_a_row",
    "late_cycles_limit: {in_window: 10001}": "safety.late_cycles_limit.in_window",
    "late_cycles_limit: {window_s: 0.009}": "safety.late_cycles_limit.window_s",
    "late_cycles_limit: {window_s: 60.1}": "safety.late_cycles_limit.window_s",
    "output_limits: {odometry.x: 0.0}": "safety.output_limits.odometry.x",
    "output_limits: {odometry.x: .nan}": "safety.output_limits",
    "oscillation: {amplitude: 0.0, in_window: 3}": "safety.oscillation.amplitude",
    "oscillation: {amplitude: 1.0, in_window: 1}": "safety.oscillation.in_window",
    "oscillation: {amplitude: 1.0}": "in_window",
    "checklist: {rate_tolerance: 0.51}": "safety.checklist.rate_tolerance",
    "checklist: {rate_tolerance: 0.0}": "safety.checklist.rate_tolerance",
    "yaw_consistency: {track: 1.0}": "wheel_radius",
    "velocity_consistency: {}": "tolerance_rad_s",
    "following_error: {track: 0.3, wheel_radius: 0.05}": GIVE_WINDOW,
    "following_error: {track: 0.3, linear_window: 0.1}": "wheel_radius",
    "following_error: {track: 0.3, wheel_radius: 0.05, linear_window: 0.0}": "following_error.linear_window",
    "following_error: {track: 0.3, wheel_radius: 0.05, linear_window: 0.1, settle_s: 0.009}": "settle_s",
    "tilt_limit: 0.5": "unknown field `tilt_limit`",
}


@pytest.mark.parametrize("key", REFUSED)
def test_what_makes_no_sense_is_refused_with_its_place(key: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(REFUSED[key])):
        decode(f"safety: {{{key}}}")


TAKEN = [
    "posture: {up_rad: 0.3, down_rad: 0.31}",
    "tilt_limit_rad: 1.5",
    "tilt_rate_limit: 1000000.0",
    "frozen_after_s: 0.01",
    "frozen_after_s: 10.0",
    "frozen_after_s: null",
    "late_cycles_limit: {in_a_row: 1, in_window: 10000, window_s: 0.01}",
    "late_cycles_limit: {in_a_row: 10000, window_s: 60.0}",
    "oscillation: {amplitude: 1.0, in_window: 2, window_s: 0.01}",
    "output_limits: {anything: 1000000.0}",
    "checklist: {rate_tolerance: 0.5}",
    "following_error: {track: 0.3, wheel_radius: 0.05, linear_window: 0.1}",
    "following_error: {track: 0.3, wheel_radius: 0.05, angular_window: 0.1, settle_s: 10.0, for_s: 0.01}",
]


@pytest.mark.parametrize("key", TAKEN)
def test_the_ends_of_what_makes_sense_are_taken(key: str) -> None:
    assert decode(f"safety: {{{key}}}") is not None


@pytest.mark.parametrize("part", PARTS)
def test_a_key_that_a_part_does_not_have_is_refused(part: type[msgspec.Struct]) -> None:
    msgspec.convert(PARTS[part], part)
    with pytest.raises(msgspec.ValidationError, match="unknown field `spare`"):
        msgspec.convert({**PARTS[part], "spare": 1.0}, part)


@pytest.mark.parametrize("part", PARTS)
def test_a_limit_that_was_read_stays_as_it_is(part: type[msgspec.Struct]) -> None:
    settings = part(**PARTS[part])
    for name in part.__struct_fields__:
        with pytest.raises(AttributeError):
            setattr(settings, name, getattr(settings, name))


@pytest.mark.parametrize("part", PARTS)
def test_values_are_given_by_name_so_that_none_is_taken_for_another(part: type[msgspec.Struct]) -> None:
    with pytest.raises(TypeError):
        part(*PARTS[part].values() or [1.0])


def decode_station(text: str) -> StationSettings | None:
    return decode_robot(f"{BASE}station: {{{text}}}", "robot.yaml").station


def test_a_robot_without_the_section_is_not_watched_over() -> None:
    assert decode_robot(BASE, "robot.yaml").station is None


def test_every_key_of_a_station_is_taken_and_has_its_default() -> None:
    assert decode_station("") == StationSettings(timeout_s=1.0, sit_down_after_s=None, sit_down={}, disarm_after_s=None)
    text = "timeout_s: 2.0, sit_down_after_s: 3.0, sit_down: {stand: 0.5, height: -1}, disarm_after_s: 4.0"
    assert decode_station(text) == StationSettings(
        timeout_s=2.0, sit_down_after_s=3.0, sit_down={"stand": 0.5, "height": -1.0}, disarm_after_s=4.0
    )


TOGETHER = "sit_down_after_s and sit_down belong together: give both or neither at station"
ORDER = "timeout_s, sit_down_after_s and disarm_after_s must increase in this order at station"
SIT_DOWN = "sit_down: {stand: 0.0}"
STATIONS_REFUSED = {
    "timeout_s: 0.19": "station.timeout_s",
    "timeout_s: 3601.0": "station.timeout_s",
    "timeout_s: .nan": "station",
    "disarm_after_s: .nan": "station",
    "disarm_after_s: .inf": "station.disarm_after_s",
    "sit_down_after_s: 0.0": "station.sit_down_after_s",
    "sit_down_after_s: 2.0": TOGETHER,
    SIT_DOWN: TOGETHER,
    f"sit_down_after_s: 2.0, {SIT_DOWN[:-4]}.nan}}": "sit_down: a value is not finite at station",
    f"sit_down_after_s: 1.0, {SIT_DOWN}": ORDER,
    f"sit_down_after_s: 3.0, {SIT_DOWN}, disarm_after_s: 2.0": ORDER,
    f"sit_down_after_s: 3.0, {SIT_DOWN}, disarm_after_s: 3.0": ORDER,
    "disarm_after_s: 0.5": ORDER,
    "timeout_s: 5.0, disarm_after_s: 5.0": ORDER,
    "timeout: 1.0": "unknown field `timeout`",
}


@pytest.mark.parametrize("key", STATIONS_REFUSED)
def test_a_station_that_makes_no_sense_is_refused_in_one_line(key: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        decode_station(key)
    assert STATIONS_REFUSED[key] in str(caught.value)
    assert "\n" not in str(caught.value)


def test_the_robot_s_lengths_in_each_check_stand_in_its_geometry() -> None:
    lengths = [field.name for field in msgspec.structs.fields(GeometrySection)]
    found: dict[str, set[str]] = {}
    for field in msgspec.structs.fields(SafetySettings):
        sections = [kind for kind in get_args(field.type) if kind in PARTS]
        names = [part.name for kind in sections for part in msgspec.structs.fields(kind) if part.name in lengths]
        found |= {field.name: set(names)} if names else {}
    assert found == {name: set(shared) for name, shared in SHARED_LENGTHS.items()}
