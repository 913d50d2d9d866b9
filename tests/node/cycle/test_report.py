# SPDX-License-Identifier: MIT
from collections.abc import Mapping
from dataclasses import dataclass, field

import pytest

from segway_ecc.firmware_io.hardware import Hardware, Sensors
from segway_ecc.node.cycle.arming import ArmingManager
from segway_ecc.node.cycle.report import NO_TILT_LIMITS, DiagnosticReport, tilt_limits_of
from segway_ecc.node.cycle.setpoints import Setpoint, SetpointRefusal, SetpointSchedule
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.timing import Histogram, LoopCounters, TimeBase
from segway_ecc.node.model.declared import declared_variables
from segway_ecc.node.model.writer import VariableWriter
from segway_ecc.node.models.cart import Cart
from segway_ecc.node.safety.modes import Action
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.safety.residual import ResidualMonitor
from segway_ecc.node.safety.settings import PostureSettings, ResidualSettings, SafetySettings
from segway_ecc.testing import RecordingHardware

PERIOD = 10_000_000


@dataclass
class Observed:
    hardware: Hardware
    sensors: Sensors | None = field(default_factory=Sensors)
    posture: Posture | None = None
    residual: ResidualMonitor | None = None
    arming: ArmingManager = field(init=False)
    schedule: SetpointSchedule = field(default_factory=lambda: SetpointSchedule(5, 3, 20))
    writer: VariableWriter = field(default_factory=lambda: VariableWriter(Cart(), declared_variables(Cart())))
    time_base: TimeBase = field(default_factory=lambda: TimeBase(PERIOD))
    histograms: dict[str, Histogram] = field(
        default_factory=lambda: {name: Histogram() for name in ("lateness", "ros", "limit")}
    )

    def __post_init__(self) -> None:
        self.arming = ArmingManager(self.hardware, self.schedule, arm_at_start=False)


@pytest.fixture
def hardware() -> RecordingHardware:
    return RecordingHardware({}, {}, ())


@pytest.fixture
def observed(hardware: RecordingHardware) -> Observed:
    return Observed(hardware)


@pytest.fixture
def counters() -> LoopCounters:
    return LoopCounters(cycles=100, started_ns=1, last_ns=990_122_281)  # 99.98765 Hz


@pytest.fixture
def report(observed: Observed, counters: LoopCounters) -> DiagnosticReport:
    return DiagnosticReport(observed, counters, PERIOD, "cart")


def gather(report: DiagnosticReport) -> Mapping[str, DiagnosticStatus]:
    report.begin()
    while report.is_pending:
        report.work()
    return {status.name: status for status in report.statuses}


def test_there_is_nothing_to_do_before_a_set_is_begun(report: DiagnosticReport) -> None:
    assert not report.is_pending
    assert report.statuses == ()


def test_a_set_takes_a_piece_per_histogram_and_per_status_and_is_there_with_the_last(report: DiagnosticReport) -> None:
    report.begin()
    assert [report.work() for _ in range(3 + 4)] == [*[False] * 6, True]
    assert [status.name for status in report.statuses] == [
        "cart: mode",
        "cart: timing",
        "cart: set-points",
        "cart: hardware",
    ]
    assert not report.is_pending


def test_a_set_that_is_not_complete_is_completed_first(report: DiagnosticReport) -> None:
    report.begin()
    report.work()
    report.begin()
    assert [report.work() for _ in range(2 + 4)] == [*[False] * 5, True]
    assert not report.is_pending


def test_the_last_set_stays_until_the_next_is_complete(observed: Observed, report: DiagnosticReport) -> None:
    gather(report)
    observed.arming.modes.fail("smoke")
    report.begin()
    report.work()
    assert report.statuses[0].message == "DISARMED: just started"


def test_the_residual_status_has_every_estimate_and_warns_of_what_is_beyond(
    observed: Observed, report: DiagnosticReport
) -> None:
    settings = ResidualSettings(
        wheel_radius=0.05,
        imu_height=0.5,
        mass=5.0,
        moment=1.0,
        payload_kg=1.0,
        slope_rad=0.1,
        friction_n_m=0.1,
        radius_share=0.1,
    )
    observed.residual = ResidualMonitor((0, 1), (2, 3), (0, 1), settings, 0.005)
    observed.residual.estimates = [0.1, 0.2, 0.0, -0.01]
    status = gather(report)["cart: residual"]
    assert (status.level, status.message) == (Level.OK, "as designed")
    assert status.values["slope"] == "+0.2 rad"
    assert status.values.keys() == {"payload", "slope", "friction", "radius", "residual"}
    observed.residual.deviations.warned = [False, True, False, False]
    status = gather(report)["cart: residual"]
    assert (status.level, status.message) == (Level.WARN, "not as designed: slope +0.2 rad")


def test_mode_status_has_reason_and_level(observed: Observed, report: DiagnosticReport) -> None:
    def told() -> tuple[Level, str]:
        status = gather(report)["cart: mode"]
        assert dict(status.values) == {
            "mode": str(observed.arming.modes.mode),
            "reason": observed.arming.modes.reason,
        }
        return status.level, status.message

    assert told() == (Level.OK, "DISARMED: just started")
    observed.arming.modes.ask(Action.ARM)
    assert told() == (Level.OK, "ARMED: asked to arm")
    observed.arming.modes.observe([], setpoints_silent=True)
    assert told() == (Level.WARN, "HOLD: no set-point arrives any more")
    observed.arming.modes.fail("smoke")
    assert told() == (Level.ERROR, "FAULT: smoke")


def test_mode_status_has_the_tilt_limits_of_the_robot_file(observed: Observed) -> None:
    safety = SafetySettings(tilt_limit_rad=0.8, posture=PostureSettings(down_rad=0.4))
    report = DiagnosticReport(observed, LoopCounters(), PERIOD, "cart", tilt_limits_of(safety))
    values = gather(report)["cart: mode"].values
    assert (values["tilt_limit_rad"], values["down_rad"]) == ("0.8", "0.4")
    assert tilt_limits_of(SafetySettings()) == tilt_limits_of(None) == NO_TILT_LIMITS
    assert NO_TILT_LIMITS.as_values() == {}


def test_timing_holds_the_counters_and_every_histogram(
    observed: Observed, counters: LoopCounters, report: DiagnosticReport
) -> None:
    counters.late, counters.overrun, counters.skipped = 3, 2, 1
    observed.time_base.follow(0, PERIOD)
    observed.histograms["lateness"].add(60)
    observed.histograms["ros"].add(20_000)
    status = gather(report)["cart: timing"]
    nothing = "p50 0.0 us, p99 0.0 us, p99.9 0.0 us, max 0.0 us"
    assert dict(status.values) == {
        "rate_hz": "99.9877",
        "wanted_rate_hz": "100",
        "cycles": "100",
        "late": "3",
        "overrun": "2",
        "skipped": "1",
        "time_base_realigned": "1",
        "lateness": nothing.replace("0.0", "0.1"),
        "ros": nothing.replace("0.0", "20.0"),
        "limit": nothing,
    }


def test_only_what_was_missed_since_the_last_report_is_a_warning(
    counters: LoopCounters, report: DiagnosticReport
) -> None:
    told = []
    for late, skipped in ((0, 0), (3, 0), (3, 0), (4, 5)):
        counters.late, counters.skipped = late, skipped
        status = gather(report)["cart: timing"]
        told.append((status.level, status.message))
    assert told == [
        (Level.OK, "99.99 Hz"),
        (Level.WARN, "3 late or skipped since the last report"),
        (Level.OK, "99.99 Hz"),
        (Level.WARN, "6 late or skipped since the last report"),
    ]


def test_refused_set_points_are_counted_by_cause_and_warn_once(observed: Observed, report: DiagnosticReport) -> None:
    schedule = observed.schedule
    schedule.add(Setpoint(1.0, 0.0), 9, now=10)
    schedule.due(10)
    schedule.refuse(SetpointRefusal.NOT_ARMED)
    schedule.add(Setpoint(float("nan"), 0.0), 10, now=10)
    schedule.add(Setpoint(float("nan"), 0.0), 10, now=10)
    status = gather(report)["cart: set-points"]
    assert (status.level, status.message) == (Level.WARN, "3 refused since the last report")
    expected = {"applied": "1", "late": "1", "refused.not_armed": "1", "refused.not_finite": "2"}
    expected |= {"parameters.written": "0", "parameters.refused": "0"}
    assert dict(status.values) == expected
    status = gather(report)["cart: set-points"]
    assert (status.level, status.message) == (Level.OK, "taken as they come")
    assert dict(status.values) == expected


def test_set_points_that_were_clamped_are_counted_and_warn_once(observed: Observed, report: DiagnosticReport) -> None:
    observed.schedule = schedule = SetpointSchedule(5, 3, 20, Setpoint(1.0, 1.0), clamps=True)
    schedule.add(Setpoint(2.0, 0.0), 10, now=10)
    schedule.add(Setpoint(0.5, -2.0), 10, now=10)
    status = gather(report)["cart: set-points"]
    assert (status.level, status.message) == (Level.WARN, "2 clamped to the limits since the last report")
    assert status.values["clamped"] == "2"
    assert gather(report)["cart: set-points"].level is Level.OK


def test_hardware_status_has_health_and_warns_of_refused_frames_once(
    hardware: RecordingHardware, report: DiagnosticReport
) -> None:
    hardware.health = {
        "link": "can0",
        "board.refused.crc": "2",
        "link.serial.refused.length": "1",
        "board.lost": "7",
        "board.refused_frames": "9",
    }
    status = gather(report)["cart: hardware"]
    assert (status.level, status.message) == (Level.WARN, "3 frames refused since the last report")
    assert dict(status.values) == hardware.health
    status = gather(report)["cart: hardware"]
    assert (status.level, status.message) == (Level.OK, "can0")


def test_hardware_status_warns_of_new_gaps_and_of_a_guard_that_is_lost(
    hardware: RecordingHardware, report: DiagnosticReport
) -> None:
    hardware.health = {"link": "can0", "board.gaps": "2", "imu.gaps": "1", "guard": "watches"}
    status = gather(report)["cart: hardware"]
    assert (status.level, status.message) == (Level.WARN, "3 gaps in telemetry since the last report")
    hardware.health = {"link": "can0", "board.gaps": "2", "imu.gaps": "1", "guard": "lost"}
    for _ in range(2):
        status = gather(report)["cart: hardware"]
        assert (status.level, status.message) == (Level.WARN, "the guard of this bus is lost")


@pytest.mark.parametrize("name", ["link.state", "link.can.state"])
def test_a_link_that_is_not_well_is_a_warning_for_as_long_as_it_lasts(
    hardware: RecordingHardware, report: DiagnosticReport, name: str
) -> None:
    hardware.health = {"link": "can0", name: "bus-off", "board.state": "ENABLED"}
    for _ in range(2):
        status = gather(report)["cart: hardware"]
        assert (status.level, status.message) == (Level.WARN, f"{name}: bus-off")
    hardware.health[name] = "active"
    assert gather(report)["cart: hardware"].level is Level.OK


def test_hardware_status_has_the_age_of_every_signal() -> None:
    hardware = RecordingHardware({"left.angle": "rad", "left.velocity": "rad/s"}, {}, ())
    hardware.health = {"link": "can0"}
    observed = Observed(hardware, Sensors((1.0, 2.0), (0.0042, float("inf")), (True, False)))
    status = gather(DiagnosticReport(observed, LoopCounters(), PERIOD, "cart"))["cart: hardware"]
    assert status.values["age.left.angle"] == "4.2 ms"
    assert status.values["age.left.velocity"] == "inf ms"


def test_robot_without_hardware_reports_none(report: DiagnosticReport) -> None:
    assert gather(report)["cart: hardware"] == DiagnosticStatus(
        Level.OK, "cart: hardware", "none: the robot is all model", {}
    )
