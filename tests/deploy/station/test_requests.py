# SPDX-License-Identifier: MIT
from typing import Any

import pytest

from segway_ecc.deploy.station.requests import Requests, ServiceResponse, once
from segway_ecc.node.safety.modes import Action

S = 1_000_000_000


@pytest.fixture
def requests(connection: Any) -> Requests:
    return Requests(connection)


@pytest.mark.parametrize("accepted", [True, False])
def test_service_response_is_returned(requests: Requests, connection: Any, replies: Any, *, accepted: bool) -> None:
    requests.send(Action.ARM, replies, 0)
    assert connection.calls == [Action.ARM]
    assert requests.is_pending
    requests.on_response(ServiceResponse(Action.ARM, 1, accepted, "tilt: too much"))
    assert replies == [(accepted, "tilt: too much")]
    assert not requests.is_pending


def test_one_that_is_not_answered_fails_after_two_seconds_and_once(
    requests: Requests, connection: Any, replies: Any
) -> None:
    requests.send(Action.ARM, replies, 0)
    requests.step(2 * S)
    assert not replies
    requests.step(2 * S + 1)
    requests.step(3 * S)
    requests.on_response(ServiceResponse(Action.ARM, 1, accepted=True, message="too late"))
    assert replies == [(False, "no answer within 2 s")]
    assert connection.calls == [Action.ARM]


def test_request_is_sent_once_service_is_ready(requests: Requests, connection: Any, replies: Any) -> None:
    connection.ready = False
    requests.send(Action.ARM, replies, 0)
    requests.step(S)
    assert not connection.calls
    connection.ready = True
    requests.step(S)
    requests.step(S)
    assert connection.calls == [Action.ARM]


def test_request_without_service_fails(requests: Requests, connection: Any, replies: Any) -> None:
    connection.ready = False
    requests.send(Action.DISARM, replies, 0)
    requests.step(2 * S + 1)
    assert replies == [(False, "no node offers disarm there; no answer within 2 s")]


def test_the_answer_to_an_earlier_request_is_not_taken_for_this_one(
    requests: Requests, connection: Any, replies: Any
) -> None:
    requests.send(Action.ARM, replies, 0)
    requests.step(3 * S)
    requests.send(Action.ARM, replies, 3 * S)
    requests.on_response(ServiceResponse(Action.ARM, 1, accepted=True, message="of the first"))
    assert len(connection.calls) == 2
    assert replies == [(False, "no answer within 2 s")]
    requests.on_response(ServiceResponse(Action.ARM, 2, accepted=True, message="of the second"))
    assert replies[1:] == [(True, "of the second")]


def test_the_same_twice_is_refused_and_another_is_not(requests: Requests, connection: Any, replies: Any) -> None:
    requests.send(Action.ARM, replies, 0)
    requests.send(Action.ARM, replies, 1)
    requests.send(Action.DISARM, replies, 1)
    assert replies == [(False, "the same request is pending; wait for its answer")]
    assert connection.calls == [Action.ARM, Action.DISARM]
    requests.fail("the end")
    assert replies[1:] == 2 * [(False, "the end")]


def test_a_reply_counts_once_and_what_it_raises_ends_nothing(replies: Any) -> None:
    reply = once(replies)
    reply(*(True, "first"))
    reply(*(False, "second"))
    assert replies == [(True, "first")]

    def failing(*_: object) -> None:
        raise ValueError

    once(failing)(*(True, "x"))
