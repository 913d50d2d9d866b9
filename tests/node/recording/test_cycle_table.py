# SPDX-License-Identifier: MIT
"""A table of cycles holds what each of their messages does."""

from collections.abc import Callable

import pytest

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.cycle_message import CycleMessage
from segway_ecc.node.recording.cycle_table import CycleTableReader
from segway_ecc.node.recording.layout import CycleLayout


def test_every_field_is_that_of_the_message(layout: CycleLayout, record: Callable[[int], CycleRecord]) -> None:
    message = CycleMessage(layout)
    records = [record(cycle) for cycle in (3, 4, 9)]
    table = CycleTableReader(layout).table([message.pack(each, 2) for each in records])
    assert table["cycle"].tolist() == [3, 4, 9]
    assert [tuple(row) for row in table["published"].tolist()] == [each.published for each in records]
    assert [tuple(row) for row in table["setpoint"].tolist()] == [tuple(each.setpoint) for each in records]
    assert [tuple(row) for row in table["model_output"].tolist()] == [each.y for each in records]
    assert [tuple(row) for row in table["valid"].tolist()] == [each.sensors.valid for each in records]
    stamps = table["stamp_s"].astype(int) * 1_000_000_000 + table["stamp_ns"]
    assert stamps.tolist() == [each.stamp_ns for each in records]
    assert (table["events"].tolist(), table["mode"].tolist()) == ([2, 2, 2], [1, 1, 1])
    assert table["start_ns"].tolist() == [77, 77, 77]


def test_no_messages_are_no_rows(layout: CycleLayout) -> None:
    assert len(CycleTableReader(layout).table([])) == 0


def test_message_of_another_robot_is_refused(layout: CycleLayout, record: Callable[[int], CycleRecord]) -> None:
    message = CycleMessage(layout).pack(record(0), 0)
    with pytest.raises(RecordingError, match="does not hold the cycles of its layout"):
        CycleTableReader(layout).table([message, message + b"\0"])
