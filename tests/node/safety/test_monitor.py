# SPDX-License-Identifier: MIT
"""The checks joined to a robot's signals: each fault is found, by name and in its time, and nothing else is."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import pytest
from msgspec.structs import replace

from segway_ecc.node.errors import ConfigurationError
from segway_ecc.node.safety.monitor import SafetyMonitor
from segway_ecc.node.safety.posture import Body
from segway_ecc.node.safety.settings import (
    NOTHING_WATCHED,
    ChecklistSettings,
    FollowingErrorSettings,
    GravitySettings,
    JointLimits,
    LateCyclesLimit,
    PostureSettings,
    ResidualSettings,
    RunawaySettings,
    SafetySettings,
    SupplyWindow,
    VelocityConsistency,
    YawConsistency,
)

MS = 1_000_000
PERIOD = 5 * MS
G = 9.80665
WHEELS = ("left.angle", "left.velocity", "right.angle", "right.velocity")
GYRO = tuple(f"imu.angular_velocity_{axis}" for axis in "xyz")
ACCELERATION = tuple(f"imu.linear_acceleration_{axis}" for axis in "xyz")
SIGNALS = (*WHEELS, *GYRO, *ACCELERATION, "supply.voltage")
YAW = YawConsistency(track=0.5, wheel_radius=0.1, tolerance_rad_s=0.5, for_s=0.05)
FOLLOWING = FollowingErrorSettings(track=0.5, wheel_radius=0.1, linear_window=0.2, settle_s=0.1, for_s=0.05)
RESIDUAL = ResidualSettings(
    wheel_radius=0.1,
    imu_height=0.5,
    mass=5.0,
    moment=1.0,
    payload_kg=1.0,
    slope_rad=0.1,
    friction_n_m=0.1,
    radius_share=0.1,
)
ALL = SafetySettings(
    tilt_limit_rad=0.6,
    tilt_rate_limit=6.0,
    wheel_velocity_limit=40.0,
    yaw_consistency=YAW,
    velocity_consistency=VelocityConsistency(tolerance_rad_s=0.5),
    following_error=FOLLOWING,
    supply=SupplyWindow(min_v=22.0, max_v=29.0),
    late_cycles_limit=LateCyclesLimit(in_a_row=3),
    checklist=ChecklistSettings(),
)


@dataclass
class Rig:
    """A robot that stands still and upright, its IMU a little noisy, in front of a monitor."""

    settings: SafetySettings = ALL
    signals: Sequence[str] = SIGNALS
    used: Sequence[int] = ()
    period_ns: int = PERIOD
    values: dict[str, float] = field(default_factory=dict)
    stale: set[str] = field(default_factory=set)
    cycle: int = 0
    freeze_imu: bool = False
    slips: str = ""
    asked: tuple[float, float] | None = None
    balances: bool = False
    sent: Sequence[float] = ()

    def __post_init__(self) -> None:
        self.monitor = SafetyMonitor(self.settings, self.signals, self.used, self.period_ns)
        self.values = {**dict.fromkeys(SIGNALS, 0.0), "imu.linear_acceleration_z": G, "supply.voltage": 25.0}
        self.deadline_ns = 7_000 * MS

    @property
    def snapshot(self) -> tuple[list[float], list[float], list[bool]]:
        names = list(self.signals)
        ages = [9.0 if name in self.stale else 0.001 * (1 + n) for n, name in enumerate(names)]
        return [self.values[name] for name in names], ages, [name not in self.stale for name in names]

    def run(self, late_ns: int = 0, skip: int = 0) -> list[str]:
        self.cycle += 1
        self.deadline_ns += (1 + skip) * self.period_ns
        if not self.freeze_imu:
            self.values["imu.angular_velocity_x"] = 1e-4 * (self.cycle % 7)
        if self.slips:
            self.values[self.slips] = 2.0 + 1e-6 * (self.cycle % 7)
        values, _, valid = self.snapshot
        start_ns = self.deadline_ns + late_ns
        balances = self.balances
        return list(self.monitor.look(values, valid, start_ns, late_ns, self.asked, self.sent, balances=balances))

    def first(self, text: str, at_most: int = 60) -> int:
        """The first cycle from now, counted from 1, in which this is told."""
        for n in range(1, at_most + 1):
            if any(text in fault for fault in self.run()):
                return n
        raise AssertionError(f"never told: {text}")

    def check(self) -> dict[str, str]:
        values, ages, valid = self.snapshot
        return {item.name: str(item) for item in self.monitor.checklist(values, ages, valid, real_time=True)}


def test_a_robot_at_rest_has_nothing_against_it() -> None:
    rig = Rig()
    assert [rig.run() for _ in range(1000)] == [[]] * 1000
    assert rig.monitor.faults == []


def set_values(**values: float) -> Callable[[Rig], None]:
    return lambda rig: rig.values.update({name.replace("__", "."): value for name, value in values.items()})


def freeze(rig: Rig) -> None:
    rig.freeze_imu = True


def slip(name: str) -> Callable[[Rig], None]:
    """A velocity that is measured anew in each cycle, while the angle stays."""
    return lambda rig: setattr(rig, "slips", name)


def ask(linear: float, angular: float) -> Callable[[Rig], None]:
    return lambda rig: setattr(rig, "asked", (linear, angular))


TRIPS: dict[str, tuple[Callable[[Rig], None], str, int]] = {
    "tilt rate": (set_values(imu__angular_velocity_y=6.1), "the body tilts at 6.10 rad/s", 1),
    "left too fast": (set_values(left__velocity=-40.1), "left.velocity is -40.10 rad/s, allowed is -40 to 40 rad/s", 1),
    "right too fast": (set_values(right__velocity=40.1), "right.velocity is 40.10 rad/s", 1),
    "supply low": (set_values(supply__voltage=21.9), "supply.voltage is 21.90 V, allowed is 22 to 29 V", 1),
    "supply high": (set_values(supply__voltage=29.1), "supply.voltage is 29.10 V", 1),
    "left encoder": (set_values(left__velocity=2.0), "the left encoder is frozen", 21),
    "right encoder": (set_values(right__velocity=2.0), "the right encoder is frozen", 21),
    "IMU": (freeze, "the IMU is frozen", 20),
    "yaw": (
        set_values(imu__angular_velocity_z=0.6),
        "the wheels turn the robot at 0.00 rad/s, the gyro reads 0.60",
        10,
    ),
    "wheels": (set_values(right__velocity=-3.0), "the wheels turn the robot at -0.60 rad/s, the gyro reads 0.00", 10),
    "does not go": (ask(0.3, 0.0), "the robot goes 0.00 m/s ahead, asked is 0.30 to 0.30 m/s", 21 + 10),
    "left slip": (slip("left.velocity"), "left.velocity is off by", 8),
    "right slip": (slip("right.velocity"), "right.velocity is off by", 8),
}


@pytest.mark.parametrize("name", TRIPS)
def test_each_fault_is_detected_in_its_time(name: str) -> None:
    happen, text, cycles = TRIPS[name]
    rig = Rig()
    for _ in range(50):
        assert rig.run() == []
    happen(rig)
    assert abs(rig.first(text) - cycles) <= (2 if "off by" in text else 0)
    assert any(text in fault for fault in rig.monitor.faults)


def test_tilt_by_the_gyro_alone_faults_in_the_cycle_that_passes_the_limit() -> None:
    rig = Rig()
    for _ in range(20):
        rig.run()
    rig.values |= {"imu.angular_velocity_y": 4.0, "imu.linear_acceleration_z": 1.5 * G}
    assert rig.first("the body leans 0.6") == 31, "4 rad/s for 5 ms each: 0.6 rad after 30 cycles"


def test_the_way_a_robot_leans_is_that_of_its_accelerometer() -> None:
    rig = Rig()
    rig.values |= {"imu.linear_acceleration_x": -G * math.sin(0.7), "imu.linear_acceleration_z": G * math.cos(0.7)}
    assert rig.first("the body leans 0.70 rad, beyond 0.6 rad") == 20, "the estimate begins with those of 0.1 s"


def test_noiseless_imu_may_repeat_while_the_wheels_rest() -> None:
    rig = Rig(SafetySettings(imu_is_noisy=False), freeze_imu=True)
    assert [rig.run() for _ in range(100)] == [[]] * 100
    rig.values["right.velocity"] = 5.0
    rig.values["right.angle"] = 1.0
    assert rig.first("the IMU is frozen") == 20


def test_lateness_and_skipped_deadlines_reach_the_watch() -> None:
    rig = Rig()
    for _ in range(50):
        assert rig.run(late_ns=2 * MS) == []
    assert [rig.run(late_ns=3 * MS) for _ in range(3)] == [
        [],
        [],
        ["3 deadlines in a row were missed, fewer than 3 are allowed"],
    ]
    rig = Rig()
    assert rig.run(skip=9) == [], "nothing was before the first"
    assert rig.run(skip=2) == []
    assert rig.run(skip=3) == ["3 deadlines in a row were missed, fewer than 3 are allowed"]


def test_a_first_cycle_in_its_time_has_missed_no_deadline() -> None:
    rig = Rig(SafetySettings(late_cycles_limit=LateCyclesLimit(in_a_row=1)))
    assert [rig.run() for _ in range(3)] == [[]] * 3
    assert rig.run(skip=1) != []


def test_skips_are_counted_from_deadlines_not_from_starts() -> None:
    rig = Rig()
    rig.run()
    assert rig.run(late_ns=round(2.4 * MS)) == []
    assert rig.run() == []
    assert rig.run(skip=2, late_ns=2 * MS) == []


def test_two_looks_at_one_deadline_are_a_period_apart() -> None:
    rig = Rig(SafetySettings(frozen_after_s=0.1), freeze_imu=True)
    for _ in range(20):
        rig.run(skip=-1)
    assert rig.run(skip=-1) != []


def test_skipped_deadlines_count_for_what_repeats() -> None:
    rig = Rig(SafetySettings(frozen_after_s=0.1), freeze_imu=True)
    assert [rig.run() for _ in range(10)] == [[]] * 10
    assert rig.run(skip=9) == []
    assert rig.run() == ["the IMU is frozen: 20 periods without a change"]


def test_following_uses_the_sides_of_the_wheels() -> None:
    turning = FollowingErrorSettings(track=0.5, wheel_radius=0.1, angular_window=0.2, settle_s=0.1, for_s=0.05)
    rig = Rig(SafetySettings(frozen_after_s=None, following_error=turning), asked=(0.0, 2.0))
    rig.values |= {"left.velocity": -5.0, "right.velocity": 5.0}
    assert [rig.run() for _ in range(100)] == [[]] * 100
    rig.asked = (0.0, -2.0)
    assert rig.first("the robot goes 2.00 rad/s turning, asked is -2.00 to -2.00 rad/s") == 30


@pytest.mark.parametrize("late_ns", [0, 200 * MS])
def test_wheels_that_turned_on_through_a_stall_are_not_against_their_angles(late_ns: int) -> None:
    rig = Rig(SafetySettings(velocity_consistency=VelocityConsistency(tolerance_rad_s=1.0)))
    rig.freeze_imu, rig.values["left.velocity"], start_ns = False, 20.0, rig.deadline_ns
    for cycle in range(200):
        late = late_ns if cycle == 100 else 0
        skip = late_ns // PERIOD - 1 if cycle == 101 and late_ns else 0
        now_ns = rig.deadline_ns + (1 + skip) * PERIOD + late
        rig.values["left.angle"] = 20.0 * (now_ns - start_ns) * 1e-9
        assert rig.run(late, skip) == []


def test_disabled_checks_report_nothing() -> None:
    rig = Rig(NOTHING_WATCHED, used=(1,), freeze_imu=True)
    rig.values |= {"left.velocity": 1e9, "imu.angular_velocity_y": 99.0, "supply.voltage": 0.0}
    assert [rig.run(skip=50, late_ns=MS * 4) for _ in range(50)] == [[]] * 50
    assert rig.monitor.needs == (1,)
    assert rig.check() == {}


NEEDS: list[tuple[SafetySettings, set[str]]] = [
    (SafetySettings(frozen_after_s=None, tilt_limit_rad=0.5), {*GYRO, *ACCELERATION}),
    (SafetySettings(frozen_after_s=None, tilt_rate_limit=0.5), {*GYRO, *ACCELERATION}),
    (SafetySettings(frozen_after_s=None, wheel_velocity_limit=5.0), {"left.velocity", "right.velocity"}),
    (SafetySettings(frozen_after_s=None, yaw_consistency=YAW), {"left.velocity", "right.velocity", GYRO[2]}),
    (SafetySettings(frozen_after_s=None, velocity_consistency=VelocityConsistency(tolerance_rad_s=1.0)), {*WHEELS}),
    (SafetySettings(frozen_after_s=None, following_error=FOLLOWING), {"left.velocity", "right.velocity"}),
    (SafetySettings(frozen_after_s=None, supply=SupplyWindow(min_v=1.0, max_v=2.0)), {"supply.voltage"}),
    (SafetySettings(), {*WHEELS, *GYRO, *ACCELERATION}),
    (SafetySettings(frozen_after_s=None, checklist=ChecklistSettings()), {*GYRO, *ACCELERATION}),
]


@pytest.mark.parametrize(("settings", "names"), NEEDS)
def test_what_a_check_needs_is_needed(settings: SafetySettings, names: set[str]) -> None:
    monitor = SafetyMonitor(settings, SIGNALS, (), PERIOD)
    assert [SIGNALS[index] for index in monitor.needs] == [name for name in SIGNALS if name in names]


def test_what_the_model_uses_is_needed_too_and_named_once() -> None:
    assert SafetyMonitor(
        SafetySettings(wheel_velocity_limit=5.0, frozen_after_s=None), WHEELS, (2, 3), PERIOD
    ).needs == (1, 2, 3)


MISSING: list[tuple[SafetySettings, str, str]] = [
    (SafetySettings(posture=PostureSettings(down_rad=0.5)), "posture", GYRO[0]),
    (SafetySettings(residual=RESIDUAL), "residual", "left.velocity"),
    (SafetySettings(tilt_limit_rad=0.5), "tilt_limit_rad", GYRO[0]),
    (SafetySettings(tilt_rate_limit=0.5), "tilt_rate_limit", GYRO[0]),
    (SafetySettings(wheel_velocity_limit=0.5), "wheel_velocity_limit", "left.velocity"),
    (SafetySettings(yaw_consistency=YAW), "yaw_consistency", "left.velocity"),
    (SafetySettings(following_error=FOLLOWING), "following_error", "left.velocity"),
    (
        SafetySettings(velocity_consistency=VelocityConsistency(tolerance_rad_s=1.0)),
        "velocity_consistency",
        "left.angle",
    ),
    (SafetySettings(supply=SupplyWindow(min_v=1.0, max_v=2.0)), "supply", "supply.voltage"),
    (SafetySettings(runaway=RunawaySettings(wheel_radius=0.1, distance_m=0.5)), "runaway", "left.velocity"),
    (SafetySettings(joint_limits={"arm": JointLimits(min_rad=0.0, max_rad=1.0)}), "joint_limits.arm", "arm.angle"),
]


@pytest.mark.parametrize(("settings", "key", "name"), MISSING)
@pytest.mark.parametrize("signals", [(), ("right.angle",), ("right.angle", "spare")])
def test_a_check_of_what_is_not_measured_is_refused(
    settings: SafetySettings, key: str, name: str, signals: tuple[str, ...]
) -> None:
    known = {0: "nothing", 1: "right.angle", 2: "right.angle, spare"}[len(signals)]
    with pytest.raises(ConfigurationError) as caught:
        SafetyMonitor(settings, signals, (), PERIOD)
    assert str(caught.value) == (
        f"safety.{key} needs '{name}', which this robot does not measure; leave {key} out, or add what measures it; "
        f"there is {known}"
    )


def test_a_robot_that_drives_on_faster_than_it_is_asked_runs_away() -> None:
    rig = Rig(SafetySettings(runaway=RunawaySettings(wheel_radius=0.1, distance_m=0.5)), asked=(0.0, 0.0))
    assert rig.run() == []
    set_values(left__velocity=10.0, right__velocity=10.0)(rig)
    assert rig.first("asked", at_most=400) == pytest.approx(0.5 / (1.0 - 0.3) / (PERIOD * 1e-9), abs=2)


def test_a_joint_beyond_its_limits_is_a_fault() -> None:
    rig = Rig(SafetySettings(joint_limits={"left": JointLimits(min_rad=-0.5, max_rad=1.0)}))
    assert rig.run() == []
    set_values(left__angle=1.01)(rig)
    assert rig.run() == ["left.angle is 1.01 rad, allowed is -0.5 to 1 rad"]


def test_a_robot_without_angles_or_imu_is_watched_for_what_it_has() -> None:
    velocities = ("left.velocity", "right.angle", "right.velocity")
    rig = Rig(SafetySettings(checklist=ChecklistSettings()), velocities)
    rig.values |= {"left.velocity": 5.0, "right.velocity": 5.0}
    assert rig.first("the right encoder is frozen") == 21
    assert [fault.partition(" is ")[0] for fault in rig.monitor.faults] == ["the right encoder"]
    assert set(rig.check()) == {"rate", "telemetry", "sensors", "plausible", "wheels_still", "real_time"}


def test_lost_sensors_are_nobody_s_plausibility() -> None:
    rig = Rig()
    for _ in range(30):
        rig.run()
    rig.stale = set(SIGNALS)
    rig.freeze_imu = True
    rig.values = dict.fromkeys(SIGNALS, 0.0)
    assert [rig.run() for _ in range(100)] == [[]] * 100


def fit() -> Rig:
    rig = Rig()
    for _ in range(202):
        rig.run()
    return rig


def test_pre_arm_checks_of_a_fit_robot_pass() -> None:
    assert fit().check() == {
        "rate": "ok: 200.00 Hz of 200 Hz over the last second",
        "telemetry": "ok: the newest value is 1.0 ms old",
        "sensors": "ok: all values are fresh",
        "plausible": "ok: nothing against sensors and deadlines",
        "imu_still": "ok: still for 1.01 s of 0.5 s",
        "tilt": "ok: 0.00 rad from upright, allowed is 0.2 rad",
        "wheels_still": "ok: the faster turns at 0.00 rad/s, allowed is 0.5 rad/s",
        "supply": "ok: 25.0 V, allowed is 22 to 29 V",
        "real_time": "ok: granted",
    }


def test_pre_arm_checks_contain_what_was_measured() -> None:
    rig = fit()
    rig.values |= {"left.velocity": -0.6, "supply.voltage": 21.0, "imu.angular_velocity_z": 0.2}
    rig.run(skip=2, late_ns=4 * MS)
    rig.stale = {"left.angle"}
    items = rig.check()
    refused = {name for name, text in items.items() if text.startswith("refused")}
    assert refused == {"sensors", "plausible", "imu_still", "wheels_still", "supply"}
    assert "too old: left.angle;" in items["sensors"]
    assert "supply.voltage is 21.00 V" in items["plausible"]
    assert "3 deadlines in a row" in items["plausible"]
    assert items["rate"].startswith("ok: 197.24 Hz"), "200 cycles in 202 periods of 5 ms and 4 ms more"
    rig.values["imu.angular_velocity_z"] = 0.0
    rig.run(skip=1)
    rig.run()
    assert "still for 0.01 s" in rig.check()["imu_still"], "three periods"
    rig.stale = {GYRO[0]}
    for _ in range(21):
        rig.run()
    items = rig.check()
    assert "still for 0.00 s" in items["imu_still"]
    assert items["tilt"] == "refused: not measured; see that the IMU sends"


def test_only_what_is_needed_counts_as_too_old_or_as_telemetry() -> None:
    rig = Rig(SafetySettings(checklist=ChecklistSettings(), frozen_after_s=None), (*WHEELS, "spare"), used=(2,))
    rig.values["spare"] = 0.0
    rig.run()
    rig.stale = {"left.angle", "spare"}
    assert rig.check()["sensors"] == "ok: all values are fresh"
    assert rig.check()["telemetry"] == "ok: the newest value is 3.0 ms old"
    rig.stale = {"right.angle"}
    assert rig.check()["telemetry"].startswith("refused: the newest value is 9000.0 ms old; look at the bus")


def test_a_robot_that_needs_no_signal_has_no_telemetry() -> None:
    rig = Rig(SafetySettings(checklist=ChecklistSettings()), ())
    rig.run()
    assert set(rig.check()) == {"rate", "sensors", "plausible", "real_time"}


def test_unknown_real_time_priority_is_not_checked() -> None:
    assert "real_time" not in {item.name for item in Rig().monitor.checklist(*Rig().snapshot, real_time=None)}


def test_a_robot_that_lies_still_on_its_front_is_still() -> None:
    rig = Rig(SafetySettings(checklist=ChecklistSettings()))
    rig.values |= {"imu.linear_acceleration_x": -G, "imu.linear_acceleration_z": 0.0}
    for _ in range(102):
        rig.run()
    assert rig.check()["imu_still"] == "ok: still for 0.51 s of 0.5 s"


def test_a_body_is_still_once_nothing_has_moved_for_0_3_s() -> None:
    rig = Rig(SafetySettings(posture=PostureSettings(down_rad=0.4)))
    was_still = []
    for _ in range(60):
        rig.run()
        was_still.append(rig.monitor.body.is_still)
    assert was_still == [False] * 59 + [True]


@pytest.mark.parametrize("wheel", ["left.velocity", "right.velocity"])
@pytest.mark.parametrize(("speed", "is_still"), [(0.5, True), (-0.5, True), (0.51, False), (-0.51, False)])
def test_a_body_is_still_where_each_wheel_is(wheel: str, speed: float, *, is_still: bool) -> None:
    rig = Rig(SafetySettings(posture=PostureSettings(down_rad=0.4)))
    rig.values[wheel] = speed
    for _ in range(61):
        rig.run()
    assert rig.monitor.body.is_still is is_still


def test_of_a_robot_without_a_posture_no_body_is_known() -> None:
    rig = Rig()
    assert rig.monitor.body == Body(None, is_still=False)
    for _ in range(200):
        rig.run()
    assert rig.monitor.body == Body(None, is_still=False)


def test_the_time_between_two_cycles_is_what_passed() -> None:
    rig = Rig()
    assert rig.monitor.elapsed_s == 0.005
    rig.run()
    rig.run(late_ns=MS)
    assert rig.monitor.elapsed_s == pytest.approx(0.006)
    rig.run(skip=2)
    assert rig.monitor.elapsed_s == pytest.approx(0.014)


def test_a_gyro_alone_is_no_imu() -> None:
    rig = Rig(SafetySettings(checklist=ChecklistSettings()), (*WHEELS, *GYRO))
    rig.run()
    assert not {"imu_still", "tilt"} & set(rig.check())


GRAVITY = GravitySettings(wheel_radius=0.1, imu_height=0.5, velocity_m_s=0.5, gyro_rad_s=0.05)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("left.velocity", 11.0),
        ("right.velocity", -11.0),
        ("imu.angular_velocity_y", 0.9),
        ("imu.linear_acceleration_x", 110.0),
        ("imu.linear_acceleration_z", -100.0),
    ],
)
def test_an_imu_that_does_not_measure_how_the_robot_moves_is_a_fault_and_not_credible(name: str, value: float) -> None:
    rig = Rig(SafetySettings(gravity=GRAVITY))
    assert rig.run() == []
    assert rig.monitor.imu_is_credible
    rig.values[name] = value
    (fault,) = rig.run()
    assert fault.startswith("the IMU does not measure how the robot moves")
    assert not rig.monitor.imu_is_credible


def test_what_gravity_needs_and_the_robot_lacks_is_refused() -> None:
    signals = [name for name in SIGNALS if name != "imu.linear_acceleration_x"]
    with pytest.raises(ConfigurationError, match=r"safety\.gravity needs 'imu\.linear_acceleration_x'"):
        SafetyMonitor(SafetySettings(gravity=GRAVITY), signals, (), PERIOD)


def test_an_imu_that_is_not_watched_is_credible() -> None:
    rig = Rig(NOTHING_WATCHED)
    rig.values["imu.linear_acceleration_z"] = 100.0
    rig.run()
    assert rig.monitor.imu_is_credible


def test_signals_that_drives_measure_only_with_the_motors_on_are_neither_stale_nor_at_rest() -> None:
    rig = Rig(stale={"left.velocity", "right.velocity"}, used=(0, 1))
    rig.run()
    values, ages, valid = rig.snapshot
    unseen = ("left.velocity", "right.velocity")
    checks = {c.name: str(c) for c in rig.monitor.checklist(values, ages, valid, real_time=True, unseen=unseen)}
    assert checks["sensors"] == "ok: all values are fresh"
    assert "unseen" in checks
    assert "wheels_still" not in checks
    assert "too old" in rig.check()["sensors"], "the same is a reason against arming where nothing explains it"


@pytest.mark.parametrize("balances", [True, False])
def test_a_wheel_that_loses_the_floor_while_the_robot_balances_may_be_too_fast_for_a_moment(*, balances: bool) -> None:
    settings = SafetySettings(gravity=replace(GRAVITY, spin_s=0.1), wheel_velocity_limit=40.0)
    rig = Rig(settings, balances=balances)
    assert [fault for _ in range(210) for fault in rig.run()] == []
    rig.values["left.velocity"] = 50.0
    faults = [rig.run() for _ in range(21)]
    assert (faults[:19] == [[]] * 19) is balances
    assert "left.velocity is 50.00 rad/s, allowed is -40 to 40 rad/s" in faults[20]


@pytest.mark.parametrize(("sent", "lifted"), [((0.0, 0.0), True), ((0.0, 0.1), False), ((), False)])
def test_a_controller_that_gives_up_as_wheels_gain_what_the_imu_does_not_feel_took_the_robot_for_lifted(
    sent: Sequence[float], *, lifted: bool
) -> None:
    rig = Rig(SafetySettings(gravity=replace(GRAVITY, spin_s=0.1)), balances=True, sent=(0.1, 0.1))
    assert [fault for _ in range(210) for fault in rig.run()] == []
    for gained in (0.7, 1.4, 2.1, 0.0):  # rad/s: 14 m/s2
        rig.values["left.velocity"] = rig.values["right.velocity"] = gained
        assert rig.run() == []
    rig.sent = sent
    faults = [fault for _ in range(20) for fault in rig.run()]
    assert faults == ["both wheels have lost the floor: the robot is lifted"] * lifted
