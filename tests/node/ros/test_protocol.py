# SPDX-License-Identifier: MIT
"""What passes between the loop and the ROS process: it arrives unchanged and in order, or is counted as lost."""

import math
import os
import queue
import threading
from collections.abc import Iterator
from unittest.mock import MagicMock

import numpy as np
import pytest
from msgspec.structs import replace

from segway_ecc.node.cycle.interfaces import Heartbeat, Inbox, Report, Request, SetValue, StampedSetpoint
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.errors import ModelError
from segway_ecc.node.ring import SLOT_BYTES, RingReader, RingWriter, open_ring
from segway_ecc.node.ros import process
from segway_ecc.node.ros.process import Subscriptions
from segway_ecc.node.ros.protocol import (
    NumberedAnswer,
    ToLoop,
    WriteResult,
    decode_answer,
    decode_inbox,
    decode_report,
    decode_status,
    decode_stranger,
    decode_write_request,
    encoder,
)
from segway_ecc.node.ros.remote import INBOX_SLOTS
from segway_ecc.node.safety.modes import Action, Answer, Mode

PERIOD_NS = 1_000_000
REPORT = Report(
    stamp_ns=1_700_000_000_123_456_789,
    mode=Mode.HOLD,
    values=[0.1, -0.0, math.inf],
    applied=StampedSetpoint(Setpoint(0.5, -0.25), 7),
    topics=[2.0],
    reason="set-points fell silent",
    cycle=12,
    drives="on",
    is_zero=False,
    heartbeat=Heartbeat("desk", 99),
    heartbeat_age_ns=5,
    set_values=(1.0,),
    at_ns=77,
)


@pytest.fixture
def memory() -> Iterator[int]:
    descriptor = open_ring(INBOX_SLOTS)
    yield descriptor
    os.close(descriptor)


@pytest.fixture
def subscriptions(memory: int) -> Subscriptions:
    return Subscriptions(RingWriter(memory), PERIOD_NS)


@pytest.fixture
def loop(memory: int, subscriptions: Subscriptions) -> RingReader:
    """The loop's end."""
    assert subscriptions.is_running
    return RingReader(memory)


def passed(report: Report) -> Report:
    return decode_report(encoder.encode(report))


def test_a_report_comes_as_it_was() -> None:
    again = passed(REPORT)
    assert replace(again, set_values=tuple(again.set_values)) == REPORT
    assert math.copysign(1.0, again.values[1]) == -1.0
    assert again.mode is Mode.HOLD


def test_a_report_of_a_robot_at_rest_comes_as_it_was() -> None:
    again = passed(Report(1, Mode.DISARMED, [math.nan], None))
    assert (again.applied, again.heartbeat, again.topics) == (None, None, [])
    assert math.isnan(again.values[0])


def test_numbers_of_another_library_are_numbers() -> None:
    again = passed(replace(REPORT, values=[np.float64(0.5), np.float32(0.5), 2]))  # as a model may give them
    assert again.values == [0.5, 0.5, 2.0]


def test_a_status_comes_as_it_was() -> None:
    status = DiagnosticStatus(Level.WARN, "left", "hot", {"temperature": "80 \u00b0C"})
    assert decode_status(encoder.encode(status)) == status


def test_answers_reach_their_requesters(subscriptions: Subscriptions, loop: RingReader) -> None:
    answers: list[tuple[str, Answer]] = []
    requests = [
        Request(Action.STOP, lambda answer: answers.append(("stop", answer))),
        Request(Action.ARM, lambda answer: answers.append(("arm", answer))),
    ]
    subscriptions.hand_over(Inbox(requests=requests))
    ((kind, body),) = loop.take_messages()
    asked = decode_inbox(body).requests
    for action, number in reversed(asked):
        answer = Answer(accepted=action is Action.STOP, message=f"{action} was asked for")
        subscriptions.answer(decode_answer(encoder.encode(NumberedAnswer(number, answer))))

    assert kind == ToLoop.INBOX
    assert [action for action, _ in asked] == [Action.STOP, Action.ARM]
    assert answers == [
        ("arm", Answer(accepted=False, message="arm was asked for")),
        ("stop", Answer(accepted=True, message="stop was asked for")),
    ]


def test_an_answer_without_a_pending_request_is_ignored(subscriptions: Subscriptions, loop: RingReader) -> None:
    answers: list[Answer] = []
    for _ in range(150):
        subscriptions.hand_over(Inbox(requests=[Request(Action.ARM, answers.append)]))
        assert len(list(loop.take_messages())) == 1
    for number in (0, 1, 50, 51, 151):
        subscriptions.answer(NumberedAnswer(number, Answer(accepted=True, message="armed")))
    assert len(answers) == 1


def test_messages_are_split_to_fit_and_arrive_once_and_in_order(subscriptions: Subscriptions, loop: RingReader) -> None:
    inbox = Inbox(
        setpoints=[
            StampedSetpoint(Setpoint(math.pi * n, -math.e * n), 1_700_000_000_000_000_000 + n) for n in range(120)
        ],
        values=[SetValue(n % 3, math.pi * n) for n in range(70)],
        stations=[Heartbeat("\u00e4" * 80, 2**62)],
    )
    subscriptions.hand_over(inbox)
    messages = [body for _, body in loop.take_messages()]
    arrived = [decode_inbox(body) for body in messages]

    assert max(map(len, messages)) < INBOX_SLOTS * SLOT_BYTES // 2
    assert [setpoint for each in arrived for setpoint in each.setpoints] == inbox.setpoints
    assert [value for each in arrived for value in each.values] == inbox.values
    assert [station for each in arrived for station in each.stations] == inbox.stations


def test_messages_wait_while_the_ring_is_full(subscriptions: Subscriptions, loop: RingReader) -> None:
    inbox = Inbox(setpoints=[StampedSetpoint(Setpoint(float(n), 0.0), None) for n in range(1000)])
    thread = threading.Thread(target=subscriptions.hand_over, args=(inbox,))
    thread.start()
    found: list[StampedSetpoint] = []
    while len(found) < len(inbox.setpoints):
        found += [setpoint for _, body in loop.take_messages() for setpoint in decode_inbox(body).setpoints]
    thread.join()
    assert found == inbox.setpoints


def test_stopping_does_not_block_on_a_full_ring(subscriptions: Subscriptions) -> None:
    subscriptions.is_running = False
    subscriptions.hand_over(Inbox(setpoints=[StampedSetpoint(Setpoint(0.0, 0.0), None)] * 1000))
    assert not subscriptions.is_running


def test_a_message_that_can_never_fit_is_refused_at_once_and_counted(
    subscriptions: Subscriptions, loop: RingReader, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("time.sleep", lambda _: pytest.fail("it waits for what cannot come true"))
    room = INBOX_SLOTS * SLOT_BYTES - 6
    sizes = []
    for size in (room + 1, room, room + 1):
        subscriptions.put(ToLoop.STRANGER, "n" * (size - 3))  # a text has three bytes before it
        sizes += [(kind, len(body)) for kind, body in loop.take_messages()]
    assert sizes == [(ToLoop.REFUSED, 1), (ToLoop.STRANGER, room), (ToLoop.REFUSED, 1)]
    assert [record.getMessage() for record in caplog.records] == [
        f"a message to the loop (STRANGER) is refused: of {room + 1} bytes it can never fit into {room}"
    ]


@pytest.mark.parametrize("letter", ["n", "\u20ac"])
def test_strangers_of_the_longest_names_do_not_keep_a_stop_from_the_loop(
    subscriptions: Subscriptions, loop: RingReader, monkeypatch: pytest.MonkeyPatch, letter: str
) -> None:
    stage, waits = MagicMock(strangers=[]), 0
    taken: list[tuple[int, bytes]] = []
    stage.do_background_work = lambda: stage.strangers.extend(f"{n} {letter * 600}" for n in range(20))

    def cycle(_: float) -> None:
        nonlocal waits
        waits += 1
        assert waits < 100
        taken.extend(loop.take_messages())

    def take_messages(_: object) -> Inbox:
        if stage.strangers:
            subscriptions.hand_over(Inbox(requests=[Request(Action.STOP, MagicMock())]))
            subscriptions.is_running = False
        return Inbox()

    stage.take_messages = take_messages
    monkeypatch.setattr("time.sleep", cycle)
    subscriptions.run(MagicMock(), stage)
    cycle(0.0)
    *strangers, (kind, body) = taken
    assert [(each, decode_stranger(text)[:3]) for each, text in strangers] == [
        (ToLoop.STRANGER, f"{n} {letter * 3}"[:3]) for n in range(20)
    ]
    assert kind == ToLoop.INBOX
    assert [request.action for request in decode_inbox(body).requests] == [Action.STOP]


def written(subscriptions: Subscriptions, loop: RingReader, *done: WriteResult) -> str:
    """What came of writing a parameter where the loop answers so."""
    answers: queue.SimpleQueue[str] = queue.SimpleQueue()

    def write() -> None:
        try:
            subscriptions.write([("Track", 0.5)])
        except ModelError as error:
            answers.put(str(error))
        else:
            answers.put("written")

    thread = threading.Thread(target=write)
    thread.start()
    while (taken := loop.take_message()) is None:
        pass
    asked = decode_write_request(taken[1])
    assert (taken[0], asked.values) == (ToLoop.WRITE, (("Track", 0.5),))
    for each in done:
        subscriptions.write_results.put(each._replace(number=asked.number + each.number))
    thread.join()
    return answers.get()


def test_a_write_returns_once_the_loop_confirms_it(subscriptions: Subscriptions, loop: RingReader) -> None:
    assert written(subscriptions, loop, WriteResult(0, None)) == "written"


def test_a_refused_parameter_write_carries_the_models_reason(subscriptions: Subscriptions, loop: RingReader) -> None:
    assert written(subscriptions, loop, WriteResult(0, "it cannot be so")) == "it cannot be so"


def test_a_late_write_result_is_not_matched_to_the_next_write(subscriptions: Subscriptions, loop: RingReader) -> None:
    assert written(subscriptions, loop, WriteResult(-1, "too late"), WriteResult(0, None)) == "written"


def test_a_loop_that_does_not_answer_is_reported(
    subscriptions: Subscriptions, loop: RingReader, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "_ANSWER_S", 0.05)
    answers = written(subscriptions, loop)
    assert answers == "the loop did not answer within 0.05 s: whether 'Track' was written is not known"
