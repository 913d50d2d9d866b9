import math
import struct
from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware_io.hardware import Sensors
from node.cycle.seams import CycleRecord
from node.cycle.setpoints import Setpoint
from node.cycle.status import Level, Status
from node.recording.codec import CYCLE, DIAGNOSTICS, FRAME_HEADER, CycleCodec, pack_diagnostics, unpack_diagnostics
from node.recording.cycle_log import Layout
from node.safety.modes import Mode

int64 = st.integers(-(2**63), 2**63 - 1)
doubles = st.floats(width=64)
names = st.integers(0, 4)


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
        draw(int64),
        draw(int64),
        draw(st.sampled_from(Mode)),
        draw(int64),
        Sensors(values(sensors), values(sensors)),
        Setpoint(draw(doubles), draw(doubles)),
        values(inputs),
        values(outputs),
        values(commands),
        values(published),
        draw(st.tuples(int64, int64, int64, int64, int64)),
    )
    return layout_with(counts), record


def bits(values: Sequence[float]) -> bytes:
    """Compares not-a-number too, and tells 0.0 from -0.0."""
    return struct.pack(f"{len(values)}d", *values)


@given(layouts_and_records())
def test_a_cycle_survives_packing_bit_for_bit(drawn: tuple[Layout, CycleRecord]) -> None:
    layout, record = drawn
    codec = CycleCodec(layout)
    frame = codec.pack(record)
    kind, length = FRAME_HEADER.unpack(frame[: FRAME_HEADER.size])
    again = codec.unpack(frame[FRAME_HEADER.size :])

    assert kind == CYCLE
    assert length == len(frame) - FRAME_HEADER.size
    assert again[:4] == record[:4]
    assert list(again.durations_ns) == list(record.durations_ns)
    for name in ("setpoint", "u", "y", "commands", "published"):
        assert bits(getattr(again, name)) == bits(getattr(record, name)), name
    assert bits(again.sensors.values) == bits(record.sensors.values)
    assert bits(again.sensors.ages) == bits(record.sensors.ages)
    assert isinstance(again.setpoint, Setpoint)


@pytest.mark.parametrize("mode", Mode)
def test_every_mode_survives(mode: Mode) -> None:
    codec = CycleCodec(layout_with((0, 0, 0, 0, 0)))
    record = CycleRecord(1, 2, mode, 3, Sensors(), Setpoint(math.inf, 0.0), (), (), (), (), (1, 2, 3, 4, 5))

    assert codec.unpack(codec.pack(record)[FRAME_HEADER.size :]).mode is mode


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
