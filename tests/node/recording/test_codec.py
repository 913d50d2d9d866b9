"""A cycle on its way to the writer: nothing is lost, and everything fits a pipe."""

import dataclasses
import math
import struct
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from firmware_io.hardware import Sensors
from node.cycle.seams import CycleRecord, HardwareAnswer, Inbox, StampedSetpoint
from node.cycle.setpoints import Setpoint
from node.cycle.status import Level, Status
from node.recording import cdr
from node.recording.codec import (
    ATOMIC_BYTES,
    CYCLE,
    DIAGNOSTICS,
    EVENTS,
    FRAME_HEADER,
    CycleCodec,
    events_message,
    pack_diagnostics,
    unpack_diagnostics,
)
from node.recording.cycle_message import stamp_of
from node.recording.happenings import restored
from node.recording.layout import Layout
from node.safety.modes import Mode

SNAPSHOT = {"values", "ages", "valid", "faults", "ready", "events", "off"}
int64 = st.integers(-(2**63), 2**63 - 1)
doubles = st.floats(width=64)
names = st.integers(0, 4)
stamps = st.integers(0, 2**31 * 10**9 - 1)


def layout_with(counts: Sequence[int]) -> Layout:
    published, sensors, inputs, outputs, commands = (tuple(f"name{i}" for i in range(count)) for count in counts)
    return Layout(
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
def layouts_and_records(draw: st.DrawFn) -> tuple[Layout, CycleRecord]:
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
    """Compares not-a-number too, and tells 0.0 from -0.0."""
    return struct.pack(f"{len(values)}d", *values)


def frames_of(codec: CycleCodec, record: CycleRecord) -> list[tuple[bytes, bytes]]:
    """Kind and body of each frame of a cycle, whatever writes they come in."""
    data, frames = b"".join(codec.pack(record)), []
    while data:
        kind, length = FRAME_HEADER.unpack_from(data)
        frames.append((kind, data[FRAME_HEADER.size : FRAME_HEADER.size + length]))
        data = data[FRAME_HEADER.size + length :]
    return frames


@given(layouts_and_records())
def test_a_cycle_survives_packing_bit_for_bit(drawn: tuple[Layout, CycleRecord]) -> None:
    layout, record = drawn
    codec = CycleCodec(layout)
    ((kind, body),) = frames_of(codec, record)
    again, events = codec.message.unpack(body)

    assert kind == CYCLE
    assert (events, len(body) + FRAME_HEADER.size) == (0, codec.size)
    assert again[:4] == record[:4]
    assert (again.durations_ns, again.start_ns) == (record.durations_ns, record.start_ns)
    for name in ("setpoint", "u", "y", "commands", "published"):
        assert bits(getattr(again, name)) == bits(getattr(record, name)), name
    assert bits(again.sensors.values) == bits(record.sensors.values)
    assert bits(again.sensors.ages) == bits(record.sensors.ages)
    # Whatever else a snapshot learns to hold has to be in the message, or be told as an event.
    for field in dataclasses.fields(Sensors):
        if field.name not in {"values", "ages", "faults", "events"}:
            assert getattr(again.sensors, field.name) == getattr(record.sensors, field.name), field.name
    assert {field.name for field in dataclasses.fields(Sensors)} == SNAPSHOT
    assert isinstance(again.setpoint, Setpoint)
    assert stamp_of(body) == record.stamp_ns


EMPTY = CycleRecord(1, 2, Mode.HOLD, 3, Sensors(), Setpoint(math.inf, 0.0), (), (), (), (), (1, 2, 3, 4, 5))


@given(st.integers(0, 300), st.integers(0, 3), st.integers(0, 900))
def test_what_happened_comes_before_its_cycle_in_writes_that_a_pipe_takes_whole(
    setpoints: int, answers: int, length: int
) -> None:
    codec = CycleCodec(layout_with((0, 0, 0, 0, 0)))
    inbox = Inbox(setpoints=[StampedSetpoint(Setpoint(0.1 * n, math.nan), 10**18 + n) for n in range(setpoints)])
    record = EMPTY._replace(
        inbox=inbox, answers=[HardwareAnswer("arm", ("x" * length, "\u00e9" * length)) for _ in range(answers)]
    )
    frames = frames_of(codec, record)
    kinds = [kind for kind, _ in frames]
    messages = [events_message(body) for kind, body in frames if kind == EVENTS]
    found = [cdr.read_cycle_events(message) for message in messages]
    texts = [text for _, held in found for text in held]
    again = restored(codec.message.unpack(frames[-1][1]).record, texts)

    assert all(len(write) <= ATOMIC_BYTES for write in codec.pack(record))
    assert kinds == [EVENTS] * (len(kinds) - 1) + [CYCLE]
    assert {cycle for cycle, _ in found} <= {1}
    assert {stamp_of(message) for message in messages} <= {2}
    assert codec.message.unpack(frames[-1][1]).events == len(texts) == setpoints + answers
    assert again.inbox is not None
    assert [stamp for _, stamp in again.inbox.setpoints] == [stamp for _, stamp in inbox.setpoints]
    assert [setpoint.linear_velocity for setpoint, _ in again.inbox.setpoints] == [0.1 * n for n in range(setpoints)]
    assert all(math.isnan(setpoint.angular_velocity) for setpoint, _ in again.inbox.setpoints)
    assert again.answers == record.answers


@given(
    int64,
    st.lists(
        st.builds(Status, st.sampled_from(Level), st.text(), st.text(), st.dictionaries(st.text(), st.text())),
        max_size=3,
    ),
)
def test_diagnostics_survive_packing(stamp_ns: int, statuses: list[Status]) -> None:
    frame = pack_diagnostics(stamp_ns, statuses)
    kind, length = FRAME_HEADER.unpack(frame[: FRAME_HEADER.size])
    message = unpack_diagnostics(frame[FRAME_HEADER.size :])

    assert kind == DIAGNOSTICS
    assert length == len(frame) - FRAME_HEADER.size
    assert message.stamp_ns == stamp_ns
    assert list(message.statuses) == statuses
