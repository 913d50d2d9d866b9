# SPDX-License-Identifier: MIT
"""The station and robots in a process of their own, over real DDS that never leaves this machine."""

import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

from segway_ecc.deploy.station import requests
from segway_ecc.deploy.station import station as station_module
from segway_ecc.deploy.station.ros_bridge import MODE_TYPE
from segway_ecc.deploy.station.station import Station
from segway_ecc.deploy.station.views import Act, Command
from segway_ecc.node.ros.messages import message_type
from segway_ecc.node.ros.runtime import ros_node
from tests.deploy.station.operated_station import Operated
from tests.patience import PATIENCE_S

over_ros = pytest.mark.ros

SEQUENCE = "segments: [{linear: 0.5, duration: 1.0}]"
HEARD = {"get": "received"}


@pytest.fixture
def operated(ros_domain: None) -> Iterator[Operated]:  # noqa: ARG001 - the domain is set first
    with Station("base 1") as station:
        yield Operated(station)


def armed(operated: Operated) -> None:
    """See that both hear each other, and arm."""
    operated.wait_for("/a", lambda robot: robot.round_trip_s is not None and robot.x is not None)
    assert operated.submit("ann", Act.ARM)() == (True, "ARMED: asked to arm")
    operated.wait_for("/a", lambda robot: robot.mode in {"ARMED", "HOLD"})


@over_ros
def test_robots_are_found_by_themselves_and_shown_whole(operated: Operated, fake_robots: Any) -> None:
    fake_robots("/", "/a")
    whole = operated.wait_for("/a", lambda robot: robot.timing and robot.round_trip_s is not None and robot.supply_v)
    assert (whole.name, whole.mode, whole.reason, whole.drives) == ("a", "DISARMED", "just started", "off")
    assert (whole.heading, whole.pitch, whole.supply_v) == pytest.approx((0.5, 0.05, 24.5))
    assert whole.can_stand
    assert whole.links["can"] == {"state": "active", "sent_per_s": "200.0"}
    assert whole.checklist["tilt"] == "refused: 1.00 rad from upright"
    assert operated.wait_for("/", lambda robot: robot.is_alive).name == "alone"
    fake_robots("/late")
    operated.wait_for("/late", lambda robot: robot.is_alive)
    assert [robot.robot for robot in operated.station.fleet().robots] == ["/", "/a", "/late"]


@over_ros
def test_a_lost_robot_is_shown_as_lost_and_comes_back(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    armed(operated)
    robots.process.send_signal(signal.SIGSTOP)
    lost = operated.wait_for("/a", lambda robot: not robot.is_alive)
    assert (lost.x, lost.round_trip_s) == (None, None)
    assert lost.age_s > 1.0
    accepted, text = operated.submit("ann", Act.DISARM)()
    assert not accepted
    assert text.startswith("the robot is lost")
    operated.wait_for("/a", lambda robot: robot.age_s > lost.age_s)
    robots.process.send_signal(signal.SIGCONT)
    operated.wait_for("/a", lambda robot: robot.is_alive)
    assert any(text.startswith("back after") for text in operated.texts())


@over_ros
def test_a_robot_that_was_killed_comes_back_as_a_new_process(operated: Operated, fake_robots: Any) -> None:
    first = fake_robots("/a")
    armed(operated)
    first.process.kill()
    operated.wait_for("/a", lambda robot: not robot.is_alive)
    fake_robots("/a")
    operated.wait_for("/a", lambda robot: robot.is_alive and robot.mode == "DISARMED")
    armed(operated)


@over_ros
def test_a_stop_is_confirmed_by_the_drive_and_latched(operated: Operated, fake_robots: Any) -> None:
    fake_robots("/a")
    armed(operated)
    accepted, text = operated.submit("bob", Act.STOP)()
    assert accepted
    assert text.endswith("drives off; stop was pressed")
    stopped = operated.wait_for("/a", lambda robot: robot.stop == "confirmed")
    assert stopped.stop_after_s is not None
    assert stopped.controller == "ann"
    assert operated.submit("ann", Act.CLEAR_FAULT)() == (True, "DISARMED: fault cleared")
    operated.wait_for("/a", lambda robot: robot.stop == "")


@over_ros
def test_stop_pressed_before_a_restart_is_delivered_to_a_robot_that_is_found_later(
    ros_domain: None,  # noqa: ARG001 - the domain is set first
    tmp_path: Path,
    fake_robots: Any,
) -> None:
    with Station("base 1", folder=tmp_path) as station:
        accepted, text = Operated(station).submit("ann", Act.STOP, robot="/r1")()
        assert not accepted
        assert text.startswith("no robot is found in this namespace")
        assert Operated(station).wait_for("/r1", lambda robot: robot.stop_kept).stop == "requested"
    with Station("base 1", folder=tmp_path) as station:
        operated = Operated(station)
        operated.wait_for("/r1", lambda robot: robot.stop == "requested")
        robots = fake_robots("/r1")
        stopped = operated.wait_for("/r1", lambda robot: robot.stop == "confirmed")
        assert (stopped.mode, stopped.drives) == ("FAULT", "off")
        assert "stop" in [received[0] for received in robots.ask("/r1", **HEARD)]
        operated.wait_for("/r1", lambda robot: not robot.stop_kept)


@over_ros
def test_stop_that_drive_ignores_fails_despite_service_answer(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    armed(operated)
    robots.ask("/a", set={"drives_stay_on": True})
    accepted, text = operated.submit("ann", Act.STOP)()
    assert not accepted
    assert text == "it answered 'FAULT: stop was pressed', but it is FAULT, drives on; retries continue"
    stops = [received for received in robots.ask("/a", **HEARD) if received[0] == "stop"]
    assert len(stops) > 1
    robots.ask("/a", set={"drives": "off"})
    operated.wait_for("/a", lambda robot: robot.stop == "confirmed")


@over_ros
def test_stop_with_unconfirmed_drives_is_not_confirmed(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    armed(operated)
    robots.ask("/a", set={"drives_fall_silent": True})
    assert operated.submit("ann", Act.STOP)() == (
        False,
        "it answered 'FAULT: stop was pressed', but it is FAULT, drives unconfirmed; retries continue",
    )
    shown = operated.wait_for("/a", lambda robot: robot.stop == "requested")
    assert (shown.drives, shown.is_zero) == ("unconfirmed", True)


@over_ros
def test_refusal_returns_robot_reason(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    operated.wait_for("/a", lambda robot: robot.round_trip_s is not None)
    robots.ask("/a", set={"refuses": "tilt: 1.00 rad from upright"})
    assert operated.submit("ann", Act.ARM)() == (False, "tilt: 1.00 rad from upright")
    robots.ask("/a", set={"is_deaf": True})
    assert operated.submit("ann", Act.ARM)() == (False, "no answer within 2 s")


@over_ros
def test_robot_without_our_heartbeat_has_no_round_trip(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    operated.wait_for("/a", lambda robot: robot.round_trip_s is not None)
    robots.ask("/a", set={"is_deaf": True})
    assert operated.wait_for("/a", lambda robot: robot.round_trip_s is None).is_alive


@over_ros
def test_driving_ends_in_zeros_and_then_silence(operated: Operated, fake_robots: Any) -> None:
    robots = fake_robots("/a")
    armed(operated)
    for _ in range(10):
        operated.drive(0.5)
        time.sleep(0.05)
    operated.wait_for("/a", lambda robot: robot.mode == "HOLD")
    driven = [received[2] for received in robots.ask("/a", **HEARD) if received[0] == "drive"]
    assert driven[-6:] == [0.5, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert "ann no longer drives: brought to rest" in operated.texts()


@over_ros
def test_a_sequence_is_played_and_broken_off_when_its_operator_leaves(
    operated: Operated, fake_robots: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(requests, "WITHIN_NS", 40_000_000_000)  # a busy machine answers late
    robots = fake_robots("/a")
    armed(operated)
    assert operated.submit("ann", Act.PLAY, text=SEQUENCE)() == (True, "one is being played")
    operated.wait_for("/a", lambda robot: robot.sequence is not None and robot.sequence.state == "done")
    (sent,) = [received[2:] for received in robots.ask("/a", **HEARD) if received[0] == "follow"]
    assert sent == [0.5, 0.0, 0.0, 0.0]
    assert operated.submit("ann", Act.PLAY, text=SEQUENCE.replace("1.0", "60"))()[0]
    operated.station.leave("ann")
    ended = operated.wait_for("/a", lambda robot: robot.controller == "")
    assert ended.sequence is not None
    assert (ended.sequence.state, ended.sequence.reason) == ("broken off", "ann is gone")


@over_ros
def test_a_text_that_is_no_sequence_is_refused(operated: Operated, fake_robots: Any) -> None:
    fake_robots("/a")
    armed(operated)
    accepted, text = operated.submit("ann", Act.PLAY, text="segments: 3")()
    assert not accepted
    assert text.startswith("one: ")


@over_ros
def test_shutdown_brings_robots_to_rest_and_answers_commands(ros_domain: None, fake_robots: Any) -> None:  # noqa: ARG001 - the domain is set first
    robots = fake_robots("/a")
    station = Station("base 1")
    with station:
        operated = Operated(station)
        armed(operated)
        operated.drive(0.5)
        operated.wait_for("/a", lambda robot: robot.linear_velocity == 0.5)
        robots.ask("/a", set={"serves_not": True})
        waiting = operated.submit("ann", Act.DISARM)
    assert waiting() == (False, "the station ends")
    driven = [received[2] for received in robots.ask("/a", **HEARD) if received[0] == "drive"]
    assert driven[0] == 0.5
    assert driven[-1] == 0.0
    assert operated.submit("ann", Act.STOP)() == (False, "the station ends")
    assert operated.submit("ann", Act.PLAY, text=SEQUENCE)() == (False, "the station ends")


@over_ros
def test_a_station_that_only_watches_sends_no_heartbeat(ros_domain: None, fake_robots: Any) -> None:  # noqa: ARG001 - the domain is set first
    robots = fake_robots("/a")
    with Station("glance", is_watching=True) as station:
        operated = Operated(station)
        operated.wait_for("/a", lambda robot: robot.timing)
        assert robots.ask("/a", get="beat") == ""


@over_ros
def test_shared_namespace_is_logged(operated: Operated, fake_robots: Any) -> None:
    fake_robots("/a")
    fake_robots("/a")
    deadline = time.monotonic() + PATIENCE_S
    while not any("2 robots share this namespace" in text for text in operated.texts()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    while not any("more than one node publishes mode" in text for text in operated.texts()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    accepted, text = operated.submit("ann", Act.STOP)()
    assert not accepted
    assert "by one of several nodes that publish mode" in text


@over_ros
def test_stop_reaches_robot_beside_a_node_that_only_publishes_its_mode(ros_domain: None, fake_robots: Any) -> None:  # noqa: ARG001 - the domain is set first
    with ros_node("another", "/a") as node:
        node.create_publisher(message_type(MODE_TYPE), "mode", 1)
        fake_robots("/a")
        with Station("base 1") as station:
            operated = Operated(station)
            deadline = time.monotonic() + PATIENCE_S
            while not any("another publishes mode" in text for text in operated.texts("/a")):
                assert time.monotonic() < deadline, operated.texts()
                time.sleep(0.05)
            armed(operated)
            accepted, text = operated.submit("ann", Act.STOP)()
            assert accepted, text
            assert text.endswith("drives off; stop was pressed")


def test_what_is_asked_of_a_station_is_bounded_and_all_of_it_is_answered(replies: Any) -> None:
    station = Station("base")
    for act in (Act.ARM, Act.STOP):
        for _ in range(257):
            station.submit("ann", Command(id=1, robot="/a", act=act), replies)
    assert replies == 2 * [(False, "the station has too much to do")]
    station.close()
    assert replies[2:] == 512 * [(False, "the station ends")]
    station.submit("ann", Command(id=1, robot="/a", act=Act.ARM), replies)
    assert len(replies) == 515


def test_station_failure_is_logged_once_and_ends_nothing(caplog: pytest.LogCaptureFixture) -> None:
    def failing() -> None:
        raise KeyError("/a")

    station = Station("base")
    assert not station._guarded(failing)
    assert not station._guarded(failing)
    assert station._guarded(lambda: None)
    assert [event.text for event in station.events(0)] == ["the station failed: KeyError: '/a'"]
    assert len(caplog.records) == 1
    station.close()


def test_sequence_that_makes_reading_fail_is_answered(monkeypatch: pytest.MonkeyPatch, replies: Any) -> None:
    def failing(*_: object) -> None:
        raise KeyError("x" * 10_000)

    monkeypatch.setattr(station_module, "read_sequence", failing)
    station = Station("base")
    station.submit("ann", Command(id=1, robot="/a", act=Act.PLAY, text=SEQUENCE), replies)
    station._readers.shutdown()
    submitted = station._commands[0]
    assert not isinstance(submitted, str)
    assert str(submitted.manoeuvre).startswith("the station failed to read it: KeyError: 'xxx")
    assert len(str(submitted.manoeuvre)) == 500
    station.close()
    assert len(replies) == 1


def test_robot_whose_messages_make_reading_fail_keeps_no_stop_from_being_sent_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    station = Station("base")
    network = MagicMock(poll=MagicMock(side_effect=KeyError("/b")))
    replies: list[tuple[bool, str]] = []
    station.submit("ann", Command(id=1, robot="/r1", act=Act.STOP), lambda *outcome: replies.append(outcome))
    monkeypatch.setattr(requests, "WITHIN_NS", -1)
    station._carry_out()
    station._step(network, is_tick=False)
    station.close()
    assert len(replies) == 1
    assert replies[0][1].startswith("no robot is found")
    assert "the station failed: KeyError: '/b'" in [event.text for event in station.events(0)]
