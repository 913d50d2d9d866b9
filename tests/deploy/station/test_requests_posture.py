# SPDX-License-Identifier: MIT
"""Standing up and sitting down are confirmed by what the robot says is in force."""

from typing import Any

import pytest

from segway_ecc.deploy.station.requests import PostureRequest
from segway_ecc.deploy.station.robot_messages import ModeReport
from segway_ecc.node.safety.modes import Mode

MS = 1_000_000
STANDS = ModeReport("alice", Mode.ARMED, "", stand=1.0)
SITS = STANDS._replace(stand=0.0)


@pytest.fixture
def stand(connection: Any) -> PostureRequest:
    return PostureRequest(connection)


def test_it_is_confirmed_once_by_the_value_in_force(stand: PostureRequest, connection: Any, replies: Any) -> None:
    stand.send(replies, 0, up=False)
    stand.on_mode(STANDS)
    assert (connection.stands, replies, stand.is_pending) == ([False], [], True)
    stand.on_mode(SITS)
    stand.on_mode(SITS)
    stand.step(5000 * MS)
    assert (connection.stands, stand.is_pending) == ([False], False)
    assert replies == [(True, "the robot has accepted it: sit down")]


def test_posture_request_repeats_and_fails_after_two_seconds(
    stand: PostureRequest, connection: Any, replies: Any
) -> None:
    stand.send(replies, 0, up=True)
    for now in range(0, 2001, 20):
        stand.on_mode(SITS)
        stand.step(now * MS)
    assert (connection.stands, replies) == ([True] * 21, [])
    stand.step(2001 * MS)
    assert replies == [(False, "the robot has not accepted it within 2 s")]
    stand.step(2200 * MS)
    assert len(connection.stands) == 21


def test_later_posture_request_replaces_earlier(stand: PostureRequest, connection: Any, replies: Any) -> None:
    stand.send(replies, 0, up=True)
    stand.send(replies, 10 * MS, up=False)
    assert replies == [(False, "replaced by a later request before it was confirmed")]
    stand.on_mode(STANDS)
    assert len(replies) == 1
    stand.on_mode(SITS)
    assert (connection.stands, replies[1]) == ([True, False], (True, "the robot has accepted it: sit down"))


def test_the_end_of_the_station_answers_it(stand: PostureRequest, replies: Any) -> None:
    stand.end("nobody asked")
    stand.send(replies, 0, up=True)
    stand.end("the station ends")
    assert replies == [(False, "the station ends")]
