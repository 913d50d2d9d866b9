# SPDX-License-Identifier: MIT
"""A stop is confirmed by what the drive does, and by nothing else."""

from typing import Any

import pytest

from segway_ecc.deploy.station.requests import ServiceResponse, Stop, StopState
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.node.safety.modes import Action, Mode

MS = 1_000_000
S = 1_000_000_000
ARMED = ModeReport("a", Mode.ARMED, "asked to arm", "on", is_zero=False)
ON = ModeReport("a", Mode.FAULT, "stop was pressed", "on", is_zero=False)
OFF = ON._replace(drives="off")


@pytest.fixture
def reported() -> list[tuple[str, str]]:
    return []


@pytest.fixture
def stop(connection: Any, reported: list[tuple[str, str]]) -> Stop:
    stop = Stop(lambda text, level: reported.append((text, level)))
    stop.connect(connection)
    return stop


def test_it_is_confirmed_by_the_drive_with_the_time_it_took(
    stop: Stop, connection: Any, replies: Any, reported: list[tuple[str, str]]
) -> None:
    stop.send("ann", replies, 1000 * MS, 1001 * MS)
    assert connection.calls == [Action.STOP]
    stop.on_response(ServiceResponse(Action.STOP, 1, accepted=True, message="FAULT: stop was pressed"))
    stop.on_mode(ARMED, 1005 * MS)
    stop.on_mode(ON, 1010 * MS)
    assert (stop.state, list(replies)) == (StopState.REQUESTED, [])
    stop.on_mode(OFF, 1023 * MS)
    assert stop.state is StopState.CONFIRMED
    assert stop.after_s == pytest.approx(0.023)
    assert replies == [(True, "stopped after 23 ms: drives off; stop was pressed")]
    assert not reported  # the reply tells it


def test_commands_of_zero_confirm_it_of_a_robot_without_drives(stop: Stop, replies: Any) -> None:
    stop.send("ann", replies, 0, 0)
    stop.on_mode(ON._replace(drives="none"), 4 * MS)
    stop.on_mode(ON._replace(drives="none", is_zero=True), 5 * MS)
    assert replies == [(True, "stopped after 5 ms: commands zero; stop was pressed")]


@pytest.mark.parametrize("drives", ["on", "unconfirmed", ""])
def test_zero_commands_do_not_confirm_stop_while_drives_report_other_than_off(
    stop: Stop, replies: Any, drives: str
) -> None:
    stop.send("ann", replies, 0, 0)
    stop.on_mode(ON._replace(drives=drives, is_zero=True), S)
    assert (stop.state, list(replies)) == (StopState.REQUESTED, [])
    stop.step(2 * S + 1)
    assert replies == [(False, f"no answer, but it is FAULT, drives {drives or 'unknown'}; retries continue")]
    stop.on_mode(OFF, 3 * S)
    assert stop.state is StopState.CONFIRMED


def test_report_before_request_does_not_confirm_stop(stop: Stop, replies: Any) -> None:
    stop.send("ann", replies, 1000 * MS, 1001 * MS)
    stop.on_mode(OFF, 1000 * MS)
    assert stop.state is StopState.REQUESTED


def test_it_is_sent_again_until_it_fails_after_two_seconds_and_then_still(
    stop: Stop, connection: Any, replies: Any, reported: list[tuple[str, str]]
) -> None:
    stop.send("ann", replies, 0, 0)
    for now in range(0, 2001, 20):
        stop.step(now * MS)
    assert connection.calls == 21 * [Action.STOP]
    assert not replies
    stop.step(2001 * MS)
    assert replies == [(False, "no answer within 2 s, tried 21 times; retries continue")]
    assert (stop.state, stop.is_pending) == (StopState.REQUESTED, False)
    for now in range(2001, 5001, 20):
        stop.step(now * MS)
    assert len(connection.calls) == 23
    stop.on_mode(OFF, 6000 * MS)
    assert stop.state is StopState.CONFIRMED
    assert len(replies) == 1
    assert reported == [("stopped after 6000 ms: drives off; stop was pressed", "warning")]


@pytest.mark.parametrize(
    ("accepted", "text"),
    [
        (True, "it answered 'FAULT: stop was pressed', but it is FAULT, drives on; retries continue"),
        (False, "it answered 'refused: FAULT: stop was pressed', but it is FAULT, drives on; retries continue"),
    ],
)
def test_failed_stop_includes_service_response(stop: Stop, replies: Any, text: str, *, accepted: bool) -> None:
    stop.send("ann", replies, 0, 0)
    stop.on_response(ServiceResponse(Action.STOP, 1, accepted, "FAULT: stop was pressed"))
    stop.on_mode(ON, S)
    stop.step(2 * S + 1)
    assert replies == [(False, text)]


def test_it_is_latched_until_the_robot_leaves_its_fault(
    stop: Stop, replies: Any, reported: list[tuple[str, str]]
) -> None:
    stop.send("ann", replies, 0, 0)
    stop.on_mode(OFF, 1)
    stop.on_mode(OFF._replace(reason="tilt"), 2)
    assert stop.state is StopState.CONFIRMED
    stop.on_mode(ModeReport("a", Mode.DISARMED, "fault cleared", "off"), 3)
    assert (stop.state, stop.after_s) == (StopState.NONE, None)
    assert reported[-1] == ("the stop is over: DISARMED: fault cleared", "warning")


def test_a_second_press_joins_the_first_and_is_sent_at_once(stop: Stop, connection: Any, replies: Any) -> None:
    stop.send("ann", replies, 0, 0)
    stop.send("ann", replies, 10 * MS, 10 * MS)
    assert len(connection.calls) == 2
    stop.on_mode(OFF, 20 * MS)
    assert replies == 2 * [(True, "stopped after 20 ms: drives off; stop was pressed")]


def test_a_press_after_a_failure_is_a_new_one(stop: Stop, replies: Any) -> None:
    stop.send("ann", replies, 0, 0)
    stop.step(3 * S)
    stop.send("ann", replies, 4 * S, 4 * S)
    stop.on_mode(OFF, 4 * S + MS)
    assert replies[1:] == [(True, "stopped after 1 ms: drives off; stop was pressed")]


def test_pending_stops_are_bounded(stop: Stop, replies: Any) -> None:
    for _ in range(101):
        stop.send("ann", replies, 0, 0)
    assert replies == [(False, "a stop is pending and not confirmed yet")]


def test_clearing_the_fault_drops_one_that_is_not_confirmed(stop: Stop, connection: Any, replies: Any) -> None:
    stop.cancel("cleared")
    assert not replies
    stop.send("ann", replies, 0, 0)
    stop.cancel("cleared")
    stop.step(10 * S)
    assert (stop.state, list(replies), len(connection.calls)) == (StopState.NONE, [(False, "cleared")], 1)
