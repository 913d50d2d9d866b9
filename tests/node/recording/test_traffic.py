# SPDX-License-Identifier: MIT
"""Raw bus traffic as a candump log."""

import re
from pathlib import Path

import can
import cantools.logreader
import pytest

from segway_ecc.firmware_io.errors import BusNotFoundError
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.traffic import CandumpLog, listen

LINE = re.compile(r"\((\d+\.\d{6})\) (\S+) ([0-9A-F]{3}|[0-9A-F]{8})#(R|[0-9A-F]*)( [RT])?")
"""A line of `candump -L` (can-utils)."""


def message(number: int, stamp_s: float = 0.0) -> can.Message:
    return can.Message(
        arbitration_id=number, data=[number & 0xFF, 2], is_extended_id=number > 0x7FF, timestamp=stamp_s, channel="can0"
    )


def test_frames_are_lines_that_others_read(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    with CandumpLog(path, 10_000) as log:
        log.write(message(0x123, 1.5))
        log.write(message(0x12345678, 1.75))
        log.write(can.Message(arbitration_id=0x7FF, is_remote_frame=True, is_extended_id=False, channel="can0"))
    lines = path.read_text().splitlines()
    with path.open() as stream:
        read = [(found.channel, found.frame_id, found.data) for found in cantools.logreader.Parser(stream)]
    back = list(can.CanutilsLogReader(path))

    assert all(LINE.fullmatch(line) for line in lines)
    assert lines[0].startswith("(1.500000) can0 123#2302")
    assert read[:2] == [("can0", 0x123, b"\x23\x02"), ("can0", 0x12345678, b"\x78\x02")]
    assert [(found.arbitration_id, found.is_extended_id, found.is_remote_frame) for found in back] == [
        (0x123, False, False),
        (0x12345678, True, False),
        (0x7FF, False, True),
    ]
    assert log.frames == 3


def test_two_files_take_turns_and_together_stay_within_the_limit(tmp_path: Path) -> None:
    path, limit = tmp_path / "bus.log", 4000
    with CandumpLog(path, limit) as log:
        for number in range(1000):
            log.write(message(number & 0x7FF, number))
            log.flush()
            assert sum(found.stat().st_size for found in tmp_path.iterdir()) <= limit + 80
    files = sorted(tmp_path.iterdir())
    stamps = [int(found.timestamp) for file in reversed(files) for found in can.CanutilsLogReader(file)]

    assert [found.name for found in files] == ["bus.log", "bus.log.1"]
    assert stamps == list(range(stamps[0], 1000))
    assert len(stamps) > 50


def test_a_file_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"cannot write .*: Is a directory; choose another --out"):
        CandumpLog(tmp_path, 1000)


def test_it_listens_and_sends_nothing(tmp_path: Path) -> None:
    path, sent = tmp_path / "bus.log", 0

    with can.Bus(interface="virtual", channel="traffic") as other, CandumpLog(path, 10_000) as log:

        def is_over() -> bool:
            nonlocal sent
            if sent < 5:
                other.send(can.Message(arbitration_id=0x100 + sent, data=[sent], is_extended_id=False))
                sent += 1
            return log.frames == 5

        listen(CanSettings(interface="virtual", channel="traffic"), log, is_over)
        received = other.recv(0)

    assert [found.arbitration_id for found in can.CanutilsLogReader(path)] == [0x100 + n for n in range(5)]
    assert {found.channel for found in can.CanutilsLogReader(path)} == {"traffic"}
    assert received is None


def test_a_missing_bus_is_reported(tmp_path: Path) -> None:
    with CandumpLog(tmp_path / "bus.log", 10_000) as log:
        with pytest.raises(BusNotFoundError, match="cannot listen on CAN bus telepathy robot"):
            listen(CanSettings(interface="telepathy"), log, lambda: True)
        with pytest.raises(BusNotFoundError, match="cannot listen on CAN bus kvaser robot"):
            listen(CanSettings(interface="kvaser"), log, lambda: True)
        with pytest.raises(BusNotFoundError, match="nosuch0"):
            listen(CanSettings(interface="socketcan", channel="nosuch0"), log, lambda: True)


def test_frames_of_can_fd_are_in_the_log_with_their_flags_and_are_read_back(tmp_path: Path) -> None:
    path, bus = tmp_path / "bus.log", CanSettings(interface="local", channel=f"traffic-{tmp_path.name}", fd=True)
    sent = [
        can.Message(arbitration_id=0x8001, data=bytes(range(48)), is_fd=True, bitrate_switch=True),
        can.Message(arbitration_id=0x100, data=bytes(64), is_fd=True, is_extended_id=False),
        can.Message(arbitration_id=0x101, data=b"classic", is_extended_id=False),
    ]
    with can.Bus(interface="local", channel=bus.channel, fd=True) as other, CandumpLog(path, 10_000) as log:

        def is_over() -> bool:
            if not log.frames:
                for frame in sent:
                    other.send(frame)
            return log.frames >= len(sent)

        listen(bus, log, is_over)

    assert f" 00008001##1{bytes(range(48)).hex().upper()}" in path.read_text()
    assert f" 100##0{bytes(64).hex().upper()}" in path.read_text()
    found = list(can.CanutilsLogReader(path))[: len(sent)]
    assert [(f.arbitration_id, bytes(f.data), f.is_fd, f.bitrate_switch) for f in found] == [
        (f.arbitration_id, bytes(f.data), f.is_fd, f.bitrate_switch) for f in sent
    ]
