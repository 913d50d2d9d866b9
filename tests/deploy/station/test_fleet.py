# SPDX-License-Identifier: MIT
"""A robot is what it output lately; a lost one is shown as lost within a second."""

import math
from collections.abc import Callable

import msgspec
import pytest

from segway_ecc.deploy.station.fleet import MOST_ROBOTS, EventLog, Fleet, Heartbeats
from segway_ecc.deploy.station.robot_messages import Health, ModeReport, Pitch, SetpointReport, Supply
from segway_ecc.deploy.station.views import RobotView
from segway_ecc.node.safety.modes import Mode
from segway_ecc.node.safety.posture import Posture
from segway_ecc.node.sequence.manoeuvre import Odometry

S = 1_000_000_000
ARMED = ModeReport("alice", Mode.ARMED, "asked to arm", "on", is_zero=False)


@pytest.fixture
def fleet(events: EventLog) -> Fleet:
    return Fleet(events)


def view(fleet: Fleet, now_s: float) -> RobotView:
    fleet.mark_lost(round(now_s * S))
    return fleet.robots["/a"].view(round(now_s * S), Heartbeats("base"))


def test_every_received_value_is_in_the_picture(fleet: Fleet) -> None:
    beats = Heartbeats("base")
    beats.due(S)
    mode = ARMED._replace(station="base", beat_ns=S, beat_age_ns=S // 1000, posture=Posture.SITTING_DOWN)
    health = Health({"rate": "ok"}, {"can": {"state": "active"}}, {"rate_hz": "100"})
    for received in (
        mode,
        Odometry(5, 1.0, 2.0, 3.0, 4.0, 5.0),
        SetpointReport(5, 6.0, 7.0),
        Pitch(8.0),
        Supply(9.0),
        health,
    ):
        fleet.update("/a", received, S + S // 100)
    beats.on_mode("/a", mode, S + S // 100)
    seen = fleet.robots["/a"].view(S + S // 10, beats)
    assert (seen.age_s, seen.round_trip_s) == pytest.approx((0.09, 0.009))
    assert msgspec.structs.replace(seen, age_s=0.0, round_trip_s=None) == RobotView(
        robot="/a",
        name="alice",
        is_alive=True,
        mode="ARMED",
        reason="asked to arm",
        drives="on",
        is_zero=False,
        x=1.0,
        y=2.0,
        heading=3.0,
        linear_velocity=4.0,
        angular_velocity=5.0,
        linear_setpoint=6.0,
        angular_setpoint=7.0,
        pitch=8.0,
        supply_v=9.0,
        checklist={"rate": "ok"},
        links={"can": {"state": "active"}},
        timing={"rate_hz": "100"},
        can_stand=True,
        posture="SITTING DOWN",
    )


def test_a_lost_robot_has_no_numbers_and_grows_older(fleet: Fleet) -> None:
    fleet.update("/a", ARMED, 0)
    fleet.update("/a", Pitch(0.1), 0)
    assert view(fleet, 1.0).is_alive
    assert view(fleet, 1.0).pitch == 0.1
    lost = view(fleet, 1.001)
    assert (lost.is_alive, lost.mode, lost.reason) == (False, "ARMED", "asked to arm")
    assert (lost.pitch, lost.is_zero, lost.round_trip_s) == (None, None, None)
    assert [view(fleet, now).age_s for now in (2.0, 3.5)] == [2.0, 3.5]


def test_only_its_mode_keeps_a_robot_alive(fleet: Fleet) -> None:
    fleet.update("/a", ARMED, 0)
    fleet.update("/a", Odometry(5, 1.0, 2.0, 3.0, 4.0, 5.0), 2 * S)
    assert not view(fleet, 2.0).is_alive
    assert view(fleet, 2.0).x is None


def test_outdated_value_is_not_shown(fleet: Fleet) -> None:
    fleet.update("/a", ARMED, 0)
    for received in (Odometry(5, 1.0, 2.0, 3.0, 4.0, 5.0), SetpointReport(5, 6.0, 7.0), Pitch(8.0), Supply(9.0)):
        fleet.update("/a", received, 0)
    fleet.update("/a", Health({"rate": "ok"}, {}, {}), 0)
    for now in (1.0, 2.0, 5.0, 6.0, 10.0, 11.0):
        fleet.update("/a", ARMED, round(now * S))
        seen = view(fleet, now)
        assert [seen.x, seen.linear_setpoint, seen.pitch] == ([1.0, 6.0, 8.0] if now <= 1.0 else [None] * 3)
        assert seen.supply_v == (9.0 if now <= 10.0 else None)
        assert bool(seen.checklist) == (now <= 5.0)


def test_a_setpoint_is_shown_only_while_one_is_in_force(fleet: Fleet) -> None:
    fleet.update("/a", ARMED, 0)
    fleet.update("/a", SetpointReport(5, 6.0, 7.0), 0)
    fleet.update("/a", ARMED._replace(mode=Mode.HOLD), 1)
    assert (view(fleet, 0.1).linear_setpoint, view(fleet, 0.1).angular_setpoint) == (0.0, 0.0)
    fleet.update("/a", ARMED._replace(mode=Mode.DISARMED), 2)
    assert view(fleet, 0.1).linear_setpoint is None


def test_numbers_that_are_none_are_not_shown(fleet: Fleet) -> None:
    fleet.update("/a", ARMED, 0)
    for received in (Pitch(math.nan), Supply(math.inf), SetpointReport(1, math.nan, 2.0)):
        fleet.update("/a", received, 0)
    seen = view(fleet, 0.1)
    assert (seen.pitch, seen.supply_v, seen.linear_setpoint, seen.angular_setpoint) == (None, None, None, 2.0)


def test_found_lost_and_back_are_logged_once_each(
    fleet: Fleet, events: EventLog, texts: Callable[[], list[str]]
) -> None:
    fleet.update("/a", ARMED, 0)
    fleet.update("/a", ARMED, S)
    for now in (1.5, 2.5, 3.0):
        view(fleet, now)
    fleet.update("/a", ARMED._replace(mode=Mode.HOLD, reason="silent"), 4 * S)
    assert view(fleet, 4.0).is_alive
    fleet.update("/a", ARMED._replace(mode=Mode.FAULT, reason="stop"), 4 * S)
    assert texts() == [
        "found alice: ARMED: asked to arm",
        "lost: no messages any more",
        "back after 3.0 s: HOLD: silent",
        "FAULT: stop",
    ]
    assert [event.level for event in events.after(0)] == ["info", "error", "warning", "error"]


def test_a_robot_is_known_from_its_mode_on(fleet: Fleet) -> None:
    fleet.update("/a", Pitch(0.1), 0)
    assert not fleet.robots


def test_no_more_robots_are_kept_than_allowed(fleet: Fleet) -> None:
    for index in range(MOST_ROBOTS + 5):
        fleet.update(f"/r{index}", ARMED, 0)
    assert len(fleet.robots) == MOST_ROBOTS
