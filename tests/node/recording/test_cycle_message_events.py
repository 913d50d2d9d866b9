# SPDX-License-Identifier: MIT
"""What happened in a cycle, as text and back."""

import math

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from segway_ecc.firmware_io.hardware import Sensors
from segway_ecc.node.cycle.interfaces import (
    CycleRecord,
    HardwareAnswer,
    Heartbeat,
    Inbox,
    PostureChange,
    Request,
    SetValue,
    StampedSetpoint,
    Written,
)
from segway_ecc.node.cycle.setpoints import Setpoint
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_message import encode_events, events_of, restore_events
from segway_ecc.node.safety.modes import Action, Answer, Mode
from segway_ecc.node.safety.posture import Posture

QUIET = CycleRecord(7, 0, Mode.ARMED, 0, Sensors(), Setpoint(0.0, 0.0), (), (), (), (), ())
numbers = st.floats(allow_nan=False)


def never(_answer: Answer) -> None:
    raise AssertionError("nobody is answered")


INBOX = Inbox(
    setpoints=[StampedSetpoint(Setpoint(0.1, -math.inf), None), StampedSetpoint(Setpoint(-0.0, 5e-324), 10**18)],
    values=[SetValue(0, 1.0), SetValue(3, math.inf)],
    requests=[Request(Action.ARM, never), Request(Action.CLEAR_FAULT, never)],
    written=[Written("Gain", 0.1, has_more=True), Written("Sub\\K 1", -1.0, "too small")],
    stations=[Heartbeat("ann's desk", 2**63 - 1)],
    introductions=["ann's desk"],
    trajectories=[Trajectory(2**62, (TimedSetpoint(0, Setpoint(0.1, -math.inf)),)), Trajectory(0, ())],
)


def again(record: CycleRecord) -> CycleRecord:
    blank = msgspec.structs.replace(record.sensors, faults=(), events=())
    return restore_events(
        replace(record, sensors=blank, inbox=None, answers=(), initial=None, posture=None),
        encode_events(events_of(record)),
    )


def test_a_cycle_without_events_has_no_pieces() -> None:
    assert events_of(QUIET) == ()
    assert events_of(replace(QUIET, inbox=Inbox())) == ()


def test_everything_that_can_arrive_survives() -> None:
    found = again(replace(QUIET, inbox=INBOX)).inbox

    assert found is not None
    # Whatever the inbox learns to hold has to be in INBOX too.
    assert all(getattr(INBOX, name) for name in Inbox.__struct_fields__ if name != "writes")  # recorded as written
    for name in Inbox.__struct_fields__:
        if name not in {"requests", "writes"}:
            assert getattr(found, name) == getattr(INBOX, name), name
            assert {type(item) for item in getattr(found, name)} == {type(getattr(INBOX, name)[0])}
    assert [request.action for request in found.requests] == [Action.ARM, Action.CLEAR_FAULT]
    assert math.copysign(1.0, found.setpoints[1].setpoint.linear_velocity) == -1.0
    found.requests[0].answer(Answer(accepted=True, message="to nobody"))


def test_faults_events_answers_and_the_first_snapshot_survive() -> None:
    initial = Sensors((0.5, 0.0), (math.inf, 0.1), (False, True), ("hot",), ready=False, events=("up",))
    record = replace(
        QUIET,
        sensors=Sensors(faults=("left: \u00fcber", "right"), events=("line 2",)),
        answers=[HardwareAnswer("obstacles", ()), HardwareAnswer("arm", ("a", "b"))],
        initial=initial,
        posture=PostureChange(Posture.FALLEN, "it leans"),
    )
    found = again(record)

    assert (found.sensors.faults, found.sensors.events) == (("left: \u00fcber", "right"), ("line 2",))
    assert found.answers == record.answers
    assert found.initial == initial
    assert found.posture == record.posture


@given(st.lists(st.tuples(numbers, numbers, st.none() | st.integers(0, 2**62)), min_size=1, max_size=5))
def test_setpoints_survive_bit_for_bit(drawn: list[tuple[float, float, int | None]]) -> None:
    setpoints = [StampedSetpoint(Setpoint(v, w), stamp) for v, w, stamp in drawn]
    found = again(replace(QUIET, inbox=Inbox(setpoints=setpoints))).inbox

    assert found is not None
    assert [repr(setpoint) for setpoint in found.setpoints] == [repr(setpoint) for setpoint in setpoints]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[]",
        "[1]",
        '["fault"]',
        '["posture", "DANCING", ""]',
        '["nothing", 1]',
        '["requests", "dance"]',
        '["values", [1]]',
        '["initial", 5]',
        '["answer", 1, 2]',
        '["__class__", 1]',
    ],
)
def test_what_is_not_understood_is_refused(text: str) -> None:
    with pytest.raises(RecordingError, match="the events of cycle 7 in the log are not understood"):
        restore_events(QUIET, [text])
