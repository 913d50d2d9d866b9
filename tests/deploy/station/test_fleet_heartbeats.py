# SPDX-License-Identifier: MIT
from typing import Any

import pytest

from segway_ecc.deploy.station.fleet import Heartbeats
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.deploy.station.views import Act
from segway_ecc.node.safety.modes import Mode
from tests.deploy.station.conftest import ARMED

MS = 1_000_000


def echo(beat_ns: int, station: str = "base", age_ns: int = 0) -> ModeReport:
    return ModeReport("a", Mode.ARMED, "", station=station, beat_ns=beat_ns, beat_age_ns=age_ns)


def test_ten_a_second() -> None:
    beats = Heartbeats("base")
    sent = [beats.due(now * MS) for now in range(1000, 1501, 50)]
    assert [stamp // MS for stamp in sent if stamp is not None] == [1000, 1100, 1200, 1300, 1400, 1500]


def received(beats: Heartbeats, reported: ModeReport, at_ns: int, robot: str = "/a") -> float | None:
    beats.on_mode(robot, reported, at_ns)
    return beats.round_trip_s(robot, at_ns)


def test_the_round_trip_is_without_the_time_the_robot_kept_it() -> None:
    beats = Heartbeats("base")
    beats.due(1000 * MS)
    assert received(beats, echo(1000 * MS, age_ns=60 * MS), 1065 * MS) == pytest.approx(0.005)
    assert received(beats, echo(1000 * MS, age_ns=60 * MS), 1050 * MS) == 0.0


@pytest.mark.parametrize(
    "reported",
    [echo(1000 * MS, station="other"), echo(999 * MS), echo(0, station=""), echo(1000 * MS, age_ns=1001 * MS)],
    ids=["of another station", "never sent", "none", "it hears us no more"],
)
def test_what_is_no_echo_of_ours_gives_no_round_trip(reported: ModeReport) -> None:
    beats = Heartbeats("base")
    beats.due(1000 * MS)
    assert received(beats, reported, 1010 * MS) is None


def test_round_trip_is_kept_for_a_second_while_robot_echoes_others() -> None:
    beats = Heartbeats("base")
    beats.due(1000 * MS)
    assert received(beats, echo(1000 * MS), 1004 * MS) == pytest.approx(0.004)
    beats.on_mode("/a", echo(7, station="other"), 1100 * MS)
    assert beats.round_trip_s("/a", 2004 * MS) == pytest.approx(0.004)
    assert beats.round_trip_s("/a", 2005 * MS) is None
    assert beats.round_trip_s("/b", 1100 * MS) is None


def test_old_stamps_are_forgotten() -> None:
    beats = Heartbeats("base")
    for index in range(51):
        beats.due(index * 100 * MS)
    assert received(beats, echo(0), 5000 * MS) is None
    assert received(beats, echo(100 * MS), 5000 * MS) is not None


def test_station_introduces_itself_where_an_operator_has_control_until_the_robot_reports_it(bench: Any) -> None:
    bench.pass_time(2000)
    assert bench.connection.introduced == [], "nobody has control"
    bench.ask("ann", Act.TAKE_CONTROL)
    bench.pass_time(2500)
    assert bench.connection.introduced == [], "no heartbeats are sent"
    bench.handler._beats.due(bench.now * MS)
    bench.pass_time(3000)
    assert bench.connection.introduced == ["base"]
    bench.pass_time(3500)
    assert bench.connection.introduced == ["base", "base"]
    beat_ns = bench.handler._beats.due(bench.now * MS)
    echo = ARMED._replace(station="base", beat_ns=beat_ns, is_introduced=True)
    bench.report(echo)
    bench.pass_time(6000)
    assert len(bench.connection.introduced) == 2
    bench.report(echo._replace(station="other", is_introduced=False))
    bench.pass_time(7000)
    assert len(bench.connection.introduced) == 2, "that is of another station"
    beat_ns = bench.handler._beats.due(bench.now * MS)
    bench.report(echo._replace(beat_ns=beat_ns, is_introduced=False))  # the robot was started again
    bench.pass_time(7500)
    assert bench.connection.introduced == ["base"] * 3
