# SPDX-License-Identifier: MIT
"""A cycle on its way to the writer: nothing is lost."""

import math
import struct
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import astuple, replace

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
from segway_ecc.node.cycle.status import DiagnosticStatus, Level
from segway_ecc.node.cycle.trajectory import TimedSetpoint, Trajectory
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.codec import (
    CYCLE,
    DIAGNOSTICS,
    EVENTS,
    CycleCodec,
    pack_cycle,
    pack_diagnostics,
    unpack_diagnostics,
)
from segway_ecc.node.recording.cycle_message import stamp_of
from segway_ecc.node.recording.layout import CycleLayout
from segway_ecc.node.safety.modes import Action, Mode
from segway_ecc.node.safety.posture import Posture

SNAPSHOT = {"values", "ages", "valid", "faults", "ready", "events", "off", "unseen"}
int64 = st.integers(-(2**63), 2**63 - 1)
doubles = st.floats(width=64)
names = st.integers(0, 4)
stamps = st.integers(0, 2**31 * 10**9 - 1)


def layout_with(counts: Sequence[int]) -> CycleLayout:
    published, sensors, inputs, outputs, commands = (tuple(f"name{i}" for i in range(count)) for count in counts)
    return CycleLayout(
        robot="r",
        published=published,
        sensors=sensors,
        inputs=inputs,
        outputs=outputs,
        commands=commands,
        odometry_frame="odom",
        base_frame="base",
        imu_frame="imu",
        joints=("l", "r"),
    )


@st.composite
def layouts_and_records(draw: st.DrawFn) -> tuple[CycleLayout, CycleRecord]:
    counts = draw(st.tuples(names, names, names, names, names))

    def values(count: int) -> tuple[float, ...]:
        return tuple(draw(st.lists(doubles, min_size=count, max_size=count)))

    published, sensors, inputs, outputs, commands = counts
    record = CycleRecord(
        draw(st.integers(0, 2**63 - 1)),
        draw(stamps),
        draw(st.sampled_from(Mode)),
        draw(int64),
        Sensors(
            values(sensors),
            values(sensors),
            tuple(draw(st.lists(st.booleans(), min_size=sensors, max_size=sensors))),
            ready=draw(st.booleans()),
            off=draw(st.booleans()),
        ),
        Setpoint(draw(doubles), draw(doubles)),
        values(inputs),
        values(outputs),
        values(commands),
        values(published),
        draw(st.tuples(int64, int64, int64, int64, int64)),
        draw(int64),
    )
    return layout_with(counts), record


def bits(values: Sequence[float]) -> bytes:
    """Compares not-a-number too, and distinguishes 0.0 from -0.0."""
    return struct.pack(f"{len(values)}d", *values)


def packed(record: CycleRecord) -> bytes:
    buffer = bytearray(b"what was there before" * 100)
    pack_cycle(record, buffer)
    return bytes(buffer)


@given(layouts_and_records())
def test_a_cycle_survives_packing_bit_for_bit(drawn: tuple[CycleLayout, CycleRecord]) -> None:
    layout, record = drawn
    codec = CycleCodec(layout)
    ((kind, body),) = codec.bodies(CYCLE, packed(record))
    again, events = codec.message.unpack(body)

    assert (kind, events) == (CYCLE, 0)
    assert len(packed(record)) <= codec.size
    assert body == codec.messages(record)[1]
    assert astuple(again)[:4] == astuple(record)[:4]
    assert (again.durations_ns, again.start_ns) == (record.durations_ns, record.start_ns)
    for name in ("setpoint", "u", "y", "commands", "published"):
        assert bits(getattr(again, name)) == bits(getattr(record, name)), name
    assert bits(again.sensors.values) == bits(record.sensors.values)
    assert bits(again.sensors.ages) == bits(record.sensors.ages)
    # Whatever else a snapshot learns to hold has to be in the message, or be recorded as an event.
    for name in Sensors.__struct_fields__:
        if name not in {"values", "ages", "faults", "events", "unseen"}:
            assert getattr(again.sensors, name) == getattr(record.sensors, name), name
    assert set(Sensors.__struct_fields__) == SNAPSHOT
    assert isinstance(again.setpoint, Setpoint)
    assert stamp_of(body) == record.stamp_ns


EMPTY = CycleRecord(1, 2, Mode.HOLD, 3, Sensors(), Setpoint(math.inf, 0.0), (), (), (), (), (1, 2, 3, 4, 5))


def all_that_can_happen() -> CycleRecord:
    """Something of everything; a field that Inbox or CycleRecord learns to hold has to be added."""
    inbox = Inbox(
        setpoints=[StampedSetpoint(Setpoint(0.1, -0.2), None), StampedSetpoint(Setpoint(0.3, 0.4), 10**18)],
        values=[SetValue(3, math.pi)],
        requests=[Request(Action.ARM, lambda _: None)],
        written=[Written("Gain", -0.0)],
        stations=[Heartbeat("caf\u00e9", 2**62)],
        introductions=["caf\u00e9"],
        trajectories=[Trajectory(7, (TimedSetpoint(0, Setpoint(0.1, 0.2)), TimedSetpoint(2**40, Setpoint(0.0, 0.0))))],
    )
    sensors = Sensors((), (), (), ("left is hot",), ready=False, events=("serial took over",), off=False)
    initial = Sensors((1.5,), (math.inf,), (False,))
    fallen = PostureChange(Posture.FALLEN, "it leans")
    answers = [HardwareAnswer("arm", ("no",))]
    record = replace(
        EMPTY, inbox=inbox, sensors=sensors, initial=initial, answers=answers, posture=fallen, warning="a slope"
    )
    assert all(getattr(inbox, name) for name in Inbox.__struct_fields__ if name != "writes")  # recorded as written
    assert all(astuple(record)[12:])
    return record


def test_events_precede_their_cycle_as_in_a_log_written_directly() -> None:
    codec, record = CycleCodec(layout_with((0, 0, 0, 0, 0))), all_that_can_happen()
    (first, events), (last, cycle) = codec.bodies(CYCLE, packed(record))

    assert (first, last) == (EVENTS, CYCLE)
    assert (events, cycle) == codec.messages(record)


@pytest.mark.parametrize("kind", [np.float64, np.float32, int])
def test_numbers_of_another_kind_are_numbers(kind: type) -> None:
    codec = CycleCodec(layout_with((0, 1, 1, 1, 1)))
    one, two = (kind(2.0),), (1.0,)
    record = replace(EMPTY, sensors=Sensors(one, two, (np.True_,)), u=one, y=one, commands=two)  # type: ignore[arg-type]
    ((_, body),) = codec.bodies(CYCLE, packed(record))
    again = codec.message.unpack(body)[0]

    assert (again.u, again.y, again.sensors.values, again.sensors.valid) == ((2.0,), (2.0,), (2.0,), (True,))


@pytest.mark.parametrize("truth", [True, np.True_])
def test_a_model_output_that_is_a_truth_value_is_recorded_as_a_number(truth: float) -> None:
    codec = CycleCodec(layout_with((0, 0, 0, 1, 0)))
    ((_, body),) = codec.bodies(CYCLE, packed(replace(EMPTY, y=(truth,))))
    assert codec.message.unpack(body)[0].y == (1.0,)


@pytest.mark.parametrize(
    ("kind", "body"), [(ord("X"), b""), (CYCLE, b""), (EVENTS, b"\x90"), (DIAGNOSTICS, b"\xc0"), (CYCLE, b"\x90")]
)
def test_what_is_no_message_of_the_loop_is_refused(kind: int, body: bytes) -> None:
    with pytest.raises(RecordingError, match="damaged"):
        CycleCodec(layout_with((0, 0, 0, 0, 0))).bodies(kind, body)


def test_a_cycle_of_another_robot_is_refused() -> None:
    with pytest.raises(RecordingError, match="damaged"):
        CycleCodec(layout_with((0, 0, 1, 0, 0))).bodies(CYCLE, packed(EMPTY))


def test_the_size_is_the_largest_there_is() -> None:
    codec = CycleCodec(layout_with((1, 2, 3, 4, 5)))
    most = replace(
        EMPTY,
        cycle=2**63,
        stamp_ns=2**62,
        mode=Mode.DISARMED,
        lateness_ns=-(2**40),
        sensors=Sensors((0.0, 0.0), (0.0, 0.0), (True, True)),
        u=(0.0,) * 3,
        y=(0.0,) * 4,
        commands=(0.0,) * 5,
        published=(0.0,),
        durations_ns=(2**40,) * 5,
        start_ns=2**50,
        inbox=Inbox(),
    )
    assert len(packed(most)) == codec.size


STATUS = DiagnosticStatus(Level.ERROR, "left", "hot", {"temperature": "80 \u00b0C"})


@given(
    int64,
    st.lists(
        st.builds(
            DiagnosticStatus, st.sampled_from(Level), st.text(), st.text(), st.dictionaries(st.text(), st.text())
        ),
        max_size=3,
    ),
)
def test_diagnostics_survive_packing(stamp_ns: int, statuses: list[DiagnosticStatus]) -> None:
    body = pack_diagnostics(stamp_ns, statuses)
    message = unpack_diagnostics(body)

    assert CycleCodec(layout_with((0, 0, 0, 0, 0))).bodies(DIAGNOSTICS, body) == [(DIAGNOSTICS, body)]
    assert message.stamp_ns == stamp_ns
    assert list(message.statuses) == statuses
