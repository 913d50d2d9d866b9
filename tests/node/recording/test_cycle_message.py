# SPDX-License-Identifier: MIT
"""The message on /cycle, read by others from its definition alone."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2._dynamic import generate_dynamic
from msgspec.structs import replace
from rosbags.highlevel import AnyReader

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.recording.cycle_log import CycleLog
from segway_ecc.node.recording.cycle_message import CYCLE_TYPE, CycleMessage
from segway_ecc.node.recording.layout import CycleLayout, field_names


def test_mcap_ros2_support_reads_every_field(layout: CycleLayout, record: Callable[[int], CycleRecord]) -> None:
    message = CycleMessage(layout)
    decode = generate_dynamic(CYCLE_TYPE, message.schema)[CYCLE_TYPE]
    read = decode(message.pack(record(9), 3))

    assert (read.cycle, read.events, read.mode) == (9, 3, 1)
    assert [getattr(read.published, field) for field in field_names(layout.published)] == list(record(9).published)


def test_rosbags_reads_every_field(tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]) -> None:
    log = CycleLog(tmp_path / "run.mcap", layout)
    log.write(record(9))
    log.close()
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        (connection,) = [found for found in reader.connections if found.topic == "/cycle"]
        ((_, stamp_ns, data),) = reader.messages([connection])
        read: Any = reader.deserialize(data, connection.msgtype)

    assert stamp_ns == record(9).stamp_ns
    assert (read.cycle, read.start_ns, read.lateness_ns, read.mode, read.ready) == (9, 77, 1000, 1, True)
    assert (read.sensor.left_angle, read.sensor.left_velocity) == (1.5, 2.5)
    assert (read.model_output.x, read.model_output.motor_voltage, read.model_output.sub_port_1) == (4.5, 5.5, 6.5)
    assert (read.command.left_voltage, read.command.right_voltage) == (7.5, 8.5)
    assert (read.valid.left_angle, read.duration_ns.limit) == (True, 5_000_000)


def test_a_robot_without_hardware_has_no_empty_parts(
    tmp_path: Path, layout: CycleLayout, record: Callable[[int], CycleRecord]
) -> None:
    bare = msgspec.structs.replace(layout, sensors=(), commands=(), inputs=())
    sensors = record(0).sensors
    log = CycleLog(tmp_path / "run.mcap", bare)
    log.write(replace(record(0), sensors=type(sensors)(), commands=(), u=()))
    log.close()
    with (tmp_path / "run.mcap").open("rb") as stream:
        (schema,) = [found for found, channel, _ in make_reader(stream).iter_messages(["/cycle"]) if channel]
    with AnyReader([tmp_path / "run.mcap"]) as reader:
        (connection,) = [found for found in reader.connections if found.topic == "/cycle"]
        read: Any = reader.deserialize(next(reader.messages([connection]))[2], connection.msgtype)

    assert isinstance(schema, Schema)
    assert schema.encoding == "ros2msg"
    assert b"segway_ecc/Sensors" not in schema.data
    assert read.model_output.motor_voltage == 5.5
