# SPDX-License-Identifier: MIT
"""A base station that watches over a robot, and is lost: what the robot does by itself, cycle by cycle."""

from collections.abc import Sequence

import msgspec
import pytest

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.errors import UnknownNameError
from segway_ecc.node.model.model import Variable, Write
from segway_ecc.node.model.sectioned import Method, SectionedModel
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.settings import StationSettings
from segway_ecc.testing import Bench, RecordingHardware

STATION = StationSettings(
    timeout_s=0.5,
    sit_down_after_s=1.0,
    sit_down={"stand": 0.0},
    disarm_after_s=2.0,
    names=("base", "base 0", "base 1", "base 2"),
)
OPEN = msgspec.structs.replace(STATION, names=())
LOST = "the base station is lost"
STAND = 0
DRIVEN = Setpoint(1.0, 0.0)


class Standing(SectionedModel):
    """Voltage = 10 linear + stand."""

    name = "standing"
    step_size = 0.01
    method = Method.DISCRETE
    states = (Variable("Linear", "m/s", 0.0, Write.NOW), Variable("Stand", "1", 1.0, Write.NOW))
    outputs = (Variable("Voltage", "V"),)

    def dynamic(self, t: float, s: Sequence[float]) -> Sequence[float]:
        del t
        return s

    def output(self) -> Sequence[float]:
        linear, stand = self.s
        return (10.0 * linear + stand,)


class Watched:
    """A robot that arms itself in its first cycle and is driven all the time, by somebody."""

    def __init__(
        self, station: StationSettings | None = STATION, *, driven: bool = True, arm_at_start: bool = True
    ) -> None:
        hardware = RecordingHardware({}, {"left.voltage": "V"}, (30.0,))
        wiring = {"Linear": "setpoint.linear_velocity", "Stand": "set.stand", "Voltage": "left.voltage"}
        self.bench = Bench(Standing(), hardware, wiring, station=station, arm_at_start=arm_at_start)
        self.hardware, self.stage = hardware, self.bench.stage
        if driven:
            for cycle in range(1, 1000):
                self.stage.send_setpoint(cycle, DRIVEN)

    def beat(self, cycles: range) -> None:
        for cycle in cycles:
            self.stage.send_heartbeat(cycle)

    def run(self, cycles: int) -> None:
        self.bench.loop.stop_reason = None
        self.bench.loop.run(self.bench.loop.counters.cycles + cycles)

    @property
    def told(self) -> list[tuple[int, Mode, str]]:
        return [tuple(transition) for transition in self.bench.cycle.arming.modes.history]  # type: ignore[misc] # three

    @property
    def volts(self) -> list[float]:
        return [record.commands[0] for record in self.bench.recorder.records]


def test_a_lost_station_means_hold_then_sit_down_then_disarm() -> None:
    watched = Watched()
    watched.beat(range(0, 101, 10))
    watched.run(400)
    assert watched.told == [
        (0, Mode.ARMED, "asked to arm"),
        (151, Mode.HOLD, LOST),
        (301, Mode.DISARMED, LOST),
    ]
    # Driven, holding its place upright, holding it while it sits, and nothing.
    assert watched.volts[1:] == [11.0] * 150 + [1.0] * 50 + [0.0] * 199
    assert watched.hardware.armed is False
    assert watched.hardware.journal.count("arm") == 1


def test_hold_sit_down_and_disarm_are_each_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.run(400)
    told = [record.getMessage() for record in caplog.records if LOST in record.getMessage()]
    assert told == [f"HOLD: {LOST}", f"{LOST}: the robot sits down", f"DISARMED: {LOST}"]


def test_robot_without_heartbeats_runs_alone() -> None:
    watched = Watched()
    watched.run(900)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]
    assert watched.volts[1:] == [11.0] * 899


def test_a_robot_that_is_not_supervised_takes_no_notice() -> None:
    watched = Watched(None)
    watched.stage.send_heartbeat(0)
    watched.run(900)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]


def test_returning_heartbeat_ends_the_hold() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.stage.send_heartbeat(80)
    watched.run(120)
    assert watched.told[1:] == [(51, Mode.HOLD, LOST), (80, Mode.ARMED, "the base station is back")]
    assert watched.volts[50:81] == [11.0] + [1.0] * 29 + [11.0]


def test_a_set_point_of_before_does_not_move_the_robot_when_the_station_comes_back() -> None:
    watched = Watched(driven=False)
    watched.beat(range(0, 11, 10))
    watched.stage.send_setpoint(10, DRIVEN)
    watched.stage.send_heartbeat(100)
    watched.stage.send_setpoint(120, DRIVEN)
    watched.run(125)
    assert watched.told[1:] == [
        (61, Mode.HOLD, LOST),
        (100, Mode.HOLD, "no set-point arrives any more"),
        (120, Mode.ARMED, "set-points arrive again"),
    ]
    assert set(watched.volts[61:120]) == {1.0}


def test_only_an_operator_makes_it_stand_again_while_heartbeats_arrive() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.stage.set_value(120, STAND, 1.0)
    watched.stage.send_heartbeat(150)
    watched.stage.send_heartbeat(190)
    watched.stage.set_value(195, STAND, 1.0)
    watched.run(200)
    assert watched.volts[100:120] == [1.0] + [0.0] * 19
    assert set(watched.volts[120:150]) == {0.0}, "told to stand up while the station is lost"
    assert set(watched.volts[150:195]) == {10.0}, "driven again, and not standing by itself"
    assert set(watched.volts[195:]) == {11.0}


def test_any_station_will_do() -> None:
    watched = Watched()
    for cycle in range(0, 300, 40):
        watched.stage.send_heartbeat(cycle, f"base {cycle // 40 % 2}", cycle)
    watched.run(300)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]


def test_heartbeats_of_who_was_not_introduced_lead_to_nothing() -> None:
    watched = Watched(OPEN)
    watched.stage.send_heartbeat(0, "anybody")
    watched.stage.send_heartbeat(100, "anybody")
    watched.run(600)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]
    assert not any(report.is_introduced for report in watched.stage.reports)
    assert watched.stage.reports[150].heartbeat == ("anybody", 0), "echoed all the same"


def test_introduction_without_heartbeats_leads_to_nothing() -> None:
    watched = Watched(OPEN)
    watched.stage.introduce_station(10, "anybody")
    watched.run(600)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]


def test_station_that_introduced_itself_is_missed() -> None:
    watched = Watched(OPEN)
    watched.beat(range(0, 101, 10))
    watched.stage.introduce_station(50)
    watched.run(200)
    assert watched.told[1:] == [(151, Mode.HOLD, LOST)]
    assert [report.is_introduced for report in watched.stage.reports[49:53]] == [False, False, True, True]


def test_stranger_does_not_hide_that_the_station_is_lost() -> None:
    watched = Watched(OPEN)
    watched.stage.introduce_station(0)
    watched.stage.send_heartbeat(0)
    for cycle in range(0, 400, 10):
        watched.stage.send_heartbeat(cycle + 1, "anybody")
    watched.run(400)
    assert [(cycle, mode) for cycle, mode, _ in watched.told[1:]] == [(51, Mode.HOLD), (201, Mode.DISARMED)]


def test_introduction_of_another_takes_nothing_from_a_station_that_is_there(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    watched = Watched(OPEN)
    watched.stage.introduce_station(0)
    watched.beat(range(0, 300, 10))
    for cycle in range(10, 300):
        watched.stage.introduce_station(cycle, f"stranger {cycle}")
        watched.stage.send_heartbeat(cycle, f"stranger {cycle}")
    watched.run(300)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]
    logged = [each.getMessage() for each in caplog.records if "introduced" in each.getMessage()]
    assert logged[0] == "base station 'base' is introduced: its heartbeats count"
    assert "is not introduced: base, stranger 10" in logged[4]
    assert len(logged) == 20


def test_stations_that_the_robot_file_declares_are_the_only_ones(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    watched = Watched()
    watched.stage.introduce_station(0, "anybody")
    watched.stage.send_heartbeat(0, "anybody")
    watched.run(600)
    assert watched.told == [(0, Mode.ARMED, "asked to arm")]
    refusal = "base station 'anybody' is not introduced: the robot file declares base, base 0, base 1, base 2"
    assert refusal in [each.getMessage() for each in caplog.records]


def test_introduction_ends_when_the_robot_was_disarmed_and_the_station_gone() -> None:
    watched = Watched(OPEN)
    watched.stage.introduce_station(0)
    watched.stage.send_heartbeat(0)
    watched.stage.send_request(300, Action.ARM)
    watched.stage.send_heartbeat(310)
    watched.run(900)
    assert watched.told[2:] == [(201, Mode.DISARMED, LOST), (300, Mode.ARMED, "asked to arm")]


def test_a_fault_is_more_severe() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.bench.clock.events[100] = lambda: watched.bench.cycle.arming.fail("smoke")
    watched.run(400)
    assert [(mode, reason) for _, mode, reason in watched.told[1:]] == [(Mode.HOLD, LOST), (Mode.FAULT, "smoke")]
    assert set(watched.volts[100:]) == {0.0}


def test_a_fault_while_the_station_is_lost_stays_when_it_would_disarm() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.stage.send_request(150, Action.STOP)
    watched.run(400)
    assert watched.told[-1] == (150, Mode.FAULT, "stop was pressed")


def test_a_robot_that_was_disarmed_for_it_is_armed_again_by_who_asks_and_runs_alone() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(0)
    watched.stage.send_request(300, Action.ARM)
    watched.run(600)
    assert watched.told[2:] == [(201, Mode.DISARMED, LOST), (300, Mode.ARMED, "asked to arm")]


def test_drives_that_are_still_arming_when_the_station_is_lost_for_long_are_disarmed() -> None:
    watched = Watched(arm_at_start=False)
    watched.hardware.measured = Sensors(ready=False)
    watched.beat(range(0, 21, 10))
    watched.stage.send_request(10, Action.ARM)
    watched.run(400)
    (answer,) = watched.stage.answers
    assert (answer.accepted, answer.message) == (False, LOST)
    assert watched.hardware.journal.count("arm") == 1
    assert watched.hardware.armed is False
    watched.hardware.measured = Sensors(ready=True)
    watched.run(10)
    assert watched.told == []


def test_drives_that_become_ready_after_the_station_was_lost_hold_at_once() -> None:
    watched = Watched(arm_at_start=False)
    watched.hardware.measured = Sensors(ready=False)
    watched.stage.send_heartbeat(0)
    watched.stage.send_request(0, Action.ARM)

    def become_ready() -> None:
        watched.hardware.measured = Sensors(ready=True)

    watched.bench.clock.events[60] = become_ready
    watched.run(80)
    assert watched.told == [(60, Mode.ARMED, "asked to arm"), (60, Mode.HOLD, LOST)]


def test_report_has_mode_reason_drives_zero_and_heartbeat() -> None:
    watched = Watched()
    watched.stage.send_heartbeat(3, "base 1", 111)
    watched.stage.send_heartbeat(5, "base 1", 222)
    watched.stage.send_request(8, Action.STOP)
    watched.run(11)
    reports = watched.stage.reports
    assert [report.cycle for report in reports] == list(range(11))
    assert [report.mode for report in reports] == [Mode.DISARMED, *[Mode.ARMED] * 8, *[Mode.FAULT] * 2]
    assert (reports[0].reason, reports[1].reason, reports[9].reason) == (
        "just started",
        "asked to arm",
        "stop was pressed",
    )
    assert {report.drives for report in reports} == {"on"}
    # What was worked out in a cycle leaves in the next: of the first and of that after the stop it is zero.
    assert [report.is_zero for report in reports] == [True, *[False] * 8, True, True]
    assert reports[2].heartbeat is None
    assert reports[3].heartbeat == ("base 1", 111)
    assert reports[4].heartbeat == ("base 1", 111)
    assert {report.heartbeat for report in reports[5:]} == {("base 1", 222)}
    ages_ms = [report.heartbeat_age_ns // 1_000_000 for report in reports[3:]]
    assert ages_ms == [0, 10, 0, 10, 20, 30, 40, 50]


def test_stations_are_echoed_in_turn_and_a_lost_one_no_more() -> None:
    watched = Watched()
    for cycle in range(0, 200, 10):
        watched.stage.send_heartbeat(cycle, "base 1", cycle)
        watched.stage.send_heartbeat(cycle + 3, "base 2", cycle)
    for cycle in range(200, 400, 10):
        watched.stage.send_heartbeat(cycle, "base 2", cycle)
    watched.run(400)
    told = [report.heartbeat.station if report.heartbeat else "" for report in watched.stage.reports]
    assert all(set(told[start : start + 20]) == {"base 1", "base 2"} for start in range(10, 280, 20))
    assert set(told[291:]) == {"base 2"}


def test_no_more_than_four_stations_are_remembered() -> None:
    watched = Watched()
    for cycle in range(60):
        watched.stage.send_heartbeat(cycle, f"base {cycle % 6}", cycle)
    watched.run(60)
    told = [report.heartbeat.stamp_ns for report in watched.stage.reports if report.heartbeat]
    assert all(cycle - stamp in range(4) for cycle, stamp in enumerate(told))
    assert len(set(told)) > len(told) // 2


@pytest.mark.parametrize(
    ("ready", "off", "told"),
    [(False, True, "off"), (False, False, "unconfirmed"), (True, False, "on"), (True, True, "on")],
)
def test_what_the_drives_do_is_what_they_say(told: str, *, ready: bool, off: bool) -> None:
    watched = Watched()
    watched.hardware.measured = Sensors(ready=ready, off=off)
    watched.run(2)
    assert [report.drives for report in watched.stage.reports] == [told, told]


def test_a_robot_without_drives_has_none() -> None:
    class Bodiless(Standing):
        pass

    wiring = {"Linear": "setpoint.linear_velocity", "Stand": "set.stand", "Voltage": "topic.voltage"}
    bench = Bench(Bodiless(), RecordingHardware({}, {}, ()), wiring)
    bench.loop.run(3)
    assert [(report.drives, report.is_zero) for report in bench.stage.reports] == [("none", True)] * 3


def test_what_is_to_be_set_must_be_wired() -> None:
    nobody = StationSettings(sit_down_after_s=2.0, sit_down={"kneel": 0.0})
    with pytest.raises(UnknownNameError, match="'kneel'; there is stand"):
        Watched(nobody)
