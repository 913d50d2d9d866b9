# SPDX-License-Identifier: MIT
"""The safety section of a robot file."""

import math
from typing import Annotated, Final

import msgspec

from segway_ecc.firmware_io.value import Positive, Section

Angle = Annotated[float, msgspec.Meta(gt=0.0, le=1.5)]
Span = Annotated[float, msgspec.Meta(ge=0.01, le=10.0)]
Count = Annotated[int, msgspec.Meta(ge=1, le=10_000)]


class YawConsistency(Section, frozen=True, kw_only=True):
    """How well the wheels and the gyro must agree on how fast the robot turns.

    Attributes:
        track: Between the wheels' points of contact, m.
        wheel_radius: m.
        tolerance_rad_s: Largest difference of the two yaw rates, rad/s.
        for_s: How long they must disagree, s.
    """

    track: Positive
    wheel_radius: Positive
    tolerance_rad_s: Positive
    for_s: Span = 0.2


class VelocityConsistency(Section, frozen=True, kw_only=True):
    """How well a wheel's angle and its velocity must agree.

    The two mean velocities over `for_s`, s, differ by `tolerance_rad_s` at the most, rad/s.
    """

    tolerance_rad_s: Positive
    for_s: Span = 0.1


class FollowingErrorSettings(Section, frozen=True, kw_only=True):
    """How closely the robot must follow its set-points, by what its wheels do.

    Its velocity must lie between the smallest and the largest set-point of the last `settle_s`, give or take a window.

    Attributes:
        track: Between the wheels' points of contact, m.
        wheel_radius: m.
        linear_window: Of the velocity ahead, m/s; None where that is not looked at.
        angular_window: Of the angular velocity, rad/s; None where that is not looked at.
        settle_s: How long the robot takes from one set-point to another, s.
        for_s: How long it must be wrong, s.
        may_rest: Whether it may also be at rest, or slower than asked, for as long as it likes: one that must stand up
            first, or goes no faster than it can balance.
    """

    track: Positive
    wheel_radius: Positive
    linear_window: Positive | None = None
    angular_window: Positive | None = None
    settle_s: Span = 1.0
    for_s: Span = 0.1
    may_rest: bool = False

    def __post_init__(self) -> None:
        """Refuse to look at nothing."""
        if self.linear_window is None and self.angular_window is None:
            raise ValueError("give linear_window (m/s), angular_window (rad/s) or both")


class RunawaySettings(Section, frozen=True, kw_only=True):
    """How far the robot may drive on, faster than its set-points ask for, before it counts as running away.

    Counted is the way beyond the smallest and the largest set-point of the last `settle_s`, and beyond rest, give or
    take a window; a velocity within them begins anew.

    Attributes:
        wheel_radius: m.
        linear_window: Of the velocity ahead, m/s.
        distance_m: Longest way, m: more than the robot is pushed by what it withstands.
        settle_s: How long the robot takes from one set-point to another, s.
    """

    wheel_radius: Positive
    linear_window: Positive = 0.3
    distance_m: Positive
    settle_s: Span = 1.5


class GravitySettings(Section, frozen=True, kw_only=True):
    """How well the IMU's accelerometer must agree with gravity, its gyro and the wheels, in the plane of pitch.

    Attributes:
        wheel_radius: m.
        imu_height: Of the IMU above the axle, m, -3 to 3.
        velocity_m_s: Largest difference of the IMU's velocities, m/s: more than the wheels slip, or drop off a kerb.
        gyro_rad_s: Largest offset of the gyro about y, rad/s.
        settle_s: How slowly the gyro's offset is learnt, s, 0.1 to 10: it is known after some four times as long.
        spin_s: How long a wheel may spin that lost the floor, s; None: not at all.
    """

    wheel_radius: Positive
    imu_height: Annotated[float, msgspec.Meta(ge=-3.0, le=3.0)]
    velocity_m_s: Positive
    gyro_rad_s: Positive
    settle_s: Annotated[float, msgspec.Meta(ge=0.1, le=10.0)] = 0.4
    spin_s: Span | None = None


class MotorSettings(Section, frozen=True, kw_only=True):
    """The motor of a wheel that takes a voltage: its resistance, Ohm, and its constant at the wheel, N m/A."""

    resistance: Positive
    constant: Positive


class ResidualSettings(Section, frozen=True, kw_only=True):
    """How a robot that balances was designed, and from which deviation on it warns; see `ResidualMonitor`.

    Attributes:
        wheel_radius: m.
        imu_height: Of the IMU above the axle, m, -3 to 3.
        mass: Of all that moves, with the wheels' inertia over the square of their radius, kg.
        moment: The body's mass times the height of its centre above the axle, kg m.
        coulomb_friction: Of each wheel, N m.
        viscous_friction: Of each wheel, N m s.
        motor: Of wheels that are commanded a voltage; None for a torque.
        delay_s: From when a command is sent until its acceleration is measured, s.
        payload_height: Above the axle, at which a payload is looked for, m; None for the centre of mass.
        payload_kg: Largest payload, more or less, kg.
        slope_rad: Largest slope, rad.
        friction_n_m: Most Coulomb friction of a wheel beyond what is known, N m.
        radius_share: Largest deviation of the tyres' radius, 1.
        for_s: How long a deviation must last, s.
    """

    wheel_radius: Positive
    imu_height: Annotated[float, msgspec.Meta(ge=-3.0, le=3.0)]
    mass: Positive
    moment: Positive
    coulomb_friction: Annotated[float, msgspec.Meta(ge=0.0, le=50.0)] = 0.0
    viscous_friction: Annotated[float, msgspec.Meta(ge=0.0, le=10.0)] = 0.0
    motor: MotorSettings | None = None
    delay_s: Annotated[float, msgspec.Meta(ge=0.0, le=0.1)] = 0.01
    payload_height: Annotated[float, msgspec.Meta(ge=0.0, le=3.0)] | None = None
    payload_kg: Positive
    slope_rad: Positive
    friction_n_m: Positive
    radius_share: Positive
    for_s: Span = 1.0


class PostureSettings(Section, frozen=True, kw_only=True):
    """How a robot that balances stands up and sits down, by its tilt from upright.

    Attributes:
        stand: The `set.<name>` that has its model stand up (1) and sit down (0).
        up_rad: Tilt within which it is up, rad.
        down_rad: Tilt beyond which it has fallen, rad: less than that at which its body touches the ground.
        fall_s: How long it may lean so far while it balances, s: it may come back from there.
        stand_up_s: How long it may take to stand up, s.
        sit_down_s: How long it may take to sit down, s.
    """

    stand: str = "stand"
    up_rad: Angle = 0.2
    down_rad: Angle
    fall_s: Span = 0.5
    stand_up_s: Span = 5.0
    sit_down_s: Span = 5.0

    def __post_init__(self) -> None:
        """Refuse angles that no robot passes through in this order."""
        if self.up_rad >= self.down_rad:
            raise ValueError(f"up_rad {self.up_rad:g} is not below down_rad {self.down_rad:g}")


class JointLimits(Section, frozen=True, kw_only=True):
    """Between which angles a joint must be, rad."""

    min_rad: Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]
    max_rad: Annotated[float, msgspec.Meta(ge=-1e4, le=1e4)]

    def __post_init__(self) -> None:
        """Refuse a window that is empty."""
        if self.min_rad >= self.max_rad:
            raise ValueError(f"min_rad {self.min_rad:g} is not below max_rad {self.max_rad:g}")


class SupplyWindow(Section, frozen=True, kw_only=True):
    """Between which voltages the supply must be, V."""

    min_v: Positive
    max_v: Positive

    def __post_init__(self) -> None:
        """Refuse a window that is empty."""
        if self.min_v >= self.max_v:
            raise ValueError(f"min_v {self.min_v:g} is not below max_v {self.max_v:g}")


class LateCyclesLimit(Section, frozen=True, kw_only=True):
    """How many missed deadlines make a broken run: in a row, or within `window_s`, s; None are not counted so.

    A deadline is missed where its cycle was skipped, or started more than half a period late.
    """

    in_a_row: Count = 5
    in_window: Count | None = None
    window_s: Annotated[float, msgspec.Meta(ge=0.01, le=60.0)] = 1.0


class OscillationLimit(Section, frozen=True, kw_only=True):
    """How often a command may change its sign.

    Attributes:
        amplitude: From beyond this on one side to beyond it on the other is a change, in the command's unit.
        in_window: So many changes are too many.
        window_s: Within this long, s.
    """

    amplitude: Positive
    in_window: Annotated[int, msgspec.Meta(ge=2, le=10_000)]
    window_s: Span = 0.2


class ChecklistSettings(Section, frozen=True, kw_only=True):
    """What must hold before the robot arms.

    Attributes:
        rate_tolerance: Largest deviation of the rate over the last second, as a fraction of the rate wanted.
        still_rate: Largest magnitude of the IMU's angular velocity, rad/s.
        still_acceleration: Largest deviation of the magnitude of its acceleration from gravity, m/s2.
        still_s: How long the IMU must have been still, s.
        tilt_rad: Largest tilt from upright, rad.
        wheel_velocity: Fastest that a wheel may turn, rad/s.
    """

    rate_tolerance: Annotated[float, msgspec.Meta(gt=0.0, le=0.5)] = 0.05
    still_rate: Positive = 0.1
    still_acceleration: Positive = 0.5
    still_s: Span = 0.5
    tilt_rad: Angle = 0.2
    wheel_velocity: Positive = 0.5


class SafetySettings(Section, frozen=True, kw_only=True):
    """What is watched; what is None is not.

    Attributes:
        tilt_limit_rad: Largest tilt from upright, rad.
        tilt_rate_limit: Largest angular velocity across the upright axis, rad/s.
        wheel_velocity_limit: Fastest that a wheel, or another axis, may turn against the body, rad/s.
        joint_limits: Between which angles an axis must be, by its name.
        frozen_after_s: How long a set of values may repeat bit for bit, s.
        posture: Of a robot that balances; None where it stands by itself.
        imu_is_noisy: Whether an IMU's values never repeat; else they may, while the wheels are at rest.
        supply: Window of the supply, where the robot measures `supply.voltage`.
        max_command: Largest magnitude of each command, in its unit, where that is below what the drive takes.
        command_slew: Fastest that a command may change, in its unit per second.
        output_limits: Largest magnitude of what the model gives, by its signal, in its unit: what the robot can neither
            do nor be.
        oscillation: How often a command may change its sign.
    """

    tilt_limit_rad: Angle | None = None
    tilt_rate_limit: Positive | None = None
    wheel_velocity_limit: Positive | None = None
    joint_limits: dict[str, JointLimits] | None = None
    frozen_after_s: Span | None = 0.1
    imu_is_noisy: bool = True
    yaw_consistency: YawConsistency | None = None
    velocity_consistency: VelocityConsistency | None = None
    following_error: FollowingErrorSettings | None = None
    runaway: RunawaySettings | None = None
    gravity: GravitySettings | None = None
    residual: ResidualSettings | None = None
    posture: PostureSettings | None = None
    supply: SupplyWindow | None = None
    late_cycles_limit: LateCyclesLimit | None = None
    max_command: Positive | None = None
    command_slew: Positive | None = None
    output_limits: dict[str, Positive] | None = None
    oscillation: OscillationLimit | None = None
    checklist: ChecklistSettings | None = None


SHARED_LENGTHS: Final[dict[str, tuple[str, ...]]] = {
    "yaw_consistency": ("track", "wheel_radius"),
    "following_error": ("track", "wheel_radius"),
    "runaway": ("wheel_radius",),
    "gravity": ("wheel_radius", "imu_height"),
    "residual": ("wheel_radius", "imu_height"),
}
"""The lengths in each check that are the robot's, and stand in its geometry."""
NOTHING_WATCHED: Final = SafetySettings(frozen_after_s=None)
"""Of a robot whose file has no such section."""


class StationSettings(Section, frozen=True, kw_only=True):
    """What the robot does by itself when the base station that watches over it falls silent.

    Attributes:
        timeout_s: Silence after which the robot holds its place, s; a station sends ten heartbeats a second.
        sit_down_after_s: Silence after which it sits down, s; None where it stands by itself.
        sit_down: What sits it down: the value of each `set.<name>`, by name.
        disarm_after_s: Silence after which the motors go off, s; None where they never do for it.
        names: The base stations whose heartbeats count; where it is empty, those that introduce themselves do.
    """

    names: tuple[Annotated[str, msgspec.Meta(min_length=1, max_length=80)], ...] = ()
    timeout_s: Annotated[float, msgspec.Meta(ge=0.2, le=3600.0)] = 1.0
    sit_down_after_s: Annotated[float, msgspec.Meta(gt=0.0, le=86_400.0)] | None = None
    sit_down: dict[str, float] = msgspec.field(default_factory=dict)
    disarm_after_s: Annotated[float, msgspec.Meta(gt=0.0, le=86_400.0)] | None = None

    def __post_init__(self) -> None:
        """Refuse steps out of their order, and to sit down without saying how."""
        if (self.sit_down_after_s is None) != (not self.sit_down):
            raise ValueError("sit_down_after_s and sit_down belong together: give both or neither")
        if not all(map(math.isfinite, self.sit_down.values())):
            raise ValueError("sit_down: a value is not finite")
        times = [s for s in (self.timeout_s, self.sit_down_after_s, self.disarm_after_s) if s is not None]
        if times != sorted(set(times)):
            raise ValueError("timeout_s, sit_down_after_s and disarm_after_s must increase in this order")
