# SPDX-License-Identifier: MIT
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.condition import FAULT, FLAGS, Answer, answer, ask, fault_name
from segway_ecc.firmware_io.drives.vesc.packets import Mode, ShortBuffer, decode_short
from segway_ecc.firmware_io.integrity import FrameRefusedError
from segway_ecc.firmware_io.links.link import Frame
from tests.fuzzing import fuzzed


@pytest.mark.parametrize(
    ("host_id", "mask", "data"),
    [(254, FAULT, "FE003200008000"), (253, FAULT, "FD003200008000"), (253, FLAGS, "FD003200200000")],
)
def test_request_is_one_frame_with_the_sender_id(host_id: int, mask: int, data: str) -> None:
    assert ask(host_id, 7, mask) == Frame(0x807, bytes.fromhex(data), is_extended=True)


@pytest.mark.parametrize(
    ("packet", "expected"),
    [
        ("320000800005", Answer(fault=5)),
        ("320000800000", Answer(fault=0)),
        ("320020000001", Answer(timed_out=True)),
        ("320020000003", Answer(timed_out=True)),
        ("320020000002", Answer(timed_out=False)),
        ("3200200000", Answer()),
    ],
)
def test_answer_carries_one_of_the_two(packet: str, expected: Answer) -> None:
    assert answer(ShortBuffer(7, Mode.PASS_ON, bytes.fromhex(packet)), 7) == expected


@pytest.mark.parametrize(
    "buffer",
    [
        ShortBuffer(8, Mode.PASS_ON, bytes.fromhex("320000800005")),
        ShortBuffer(7, Mode.PROCESS, bytes.fromhex("320000800005")),
        ShortBuffer(7, Mode.PASS_ON, bytes.fromhex("320000000105")),
        ShortBuffer(7, Mode.PASS_ON, bytes.fromhex("320000000100")),
        ShortBuffer(7, Mode.PASS_ON, bytes.fromhex("040000")),
    ],
)
def test_what_is_no_answer_is_refused(buffer: ShortBuffer) -> None:
    with pytest.raises(FrameRefusedError):
        answer(buffer, 7)


def test_faults_have_names_where_they_are_known() -> None:
    assert fault_name(1) == "over-voltage (fault 1)"
    assert fault_name(99) == "fault 99"


@fuzzed
@given(st.binary(max_size=8))
def test_an_answer_is_understood_or_refused(data: bytes) -> None:
    for packet in (data, b"\x07\x01\x32\x00\x00\x80\x00" + data[:1], b"\x07\x01\x32\x00\x20\x00\x00" + data[:1]):
        with contextlib.suppress(FrameRefusedError):
            told = answer(decode_short(packet), 7)
            assert told.fault is None or told.timed_out is None
            assert told.fault is None or 0 <= told.fault <= 255
