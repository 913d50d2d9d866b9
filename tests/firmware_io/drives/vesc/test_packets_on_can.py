# SPDX-License-Identifier: MIT
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.frames import PacketId
from segway_ecc.firmware_io.drives.vesc.packets import Mode, PacketAssembler, ShortBuffer, decode_short, frames_of
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal, crc16_xmodem
from segway_ecc.firmware_io.links.link import Frame
from tests.fuzzing import fuzzed


def test_a_question_fits_one_frame() -> None:
    """GET_VALUES_SELECTIVE for the fault, from 254 to the controller 5."""
    (frame,) = frames_of(5, 254, Mode.PROCESS, bytes.fromhex("3200008000"))
    assert frame == Frame(0x805, bytes.fromhex("FE003200008000"), is_extended=True)


def test_a_packet_of_seven_bytes_takes_two_frames_and_its_crc() -> None:
    packet = bytes(range(1, 8))
    fill, process = frames_of(7, 2, Mode.PASS_ON, packet)
    assert fill == Frame(0x507, b"\0" + packet, is_extended=True)
    crc = crc16_xmodem(packet)
    assert process == Frame(0x707, bytes((2, 1, 0, 7, crc >> 8, crc & 0xFF)), is_extended=True)


def _rebuilt(frames: list[Frame]) -> bytes:
    """As a receiver puts it together."""
    buffer = bytearray()
    for frame in frames:
        match frame.arbitration_id >> 8:
            case 5:
                assert frame.data[0] == len(buffer)
                buffer += frame.data[1:]
            case 6:
                assert int.from_bytes(frame.data[:2], "big") == len(buffer) >= 256
                buffer += frame.data[2:]
            case 7:
                length, crc = int.from_bytes(frame.data[2:4], "big"), int.from_bytes(frame.data[4:], "big")
                assert (length, crc) == (len(buffer), crc16_xmodem(bytes(buffer)))
            case 8:
                buffer += frame.data[2:]
    return bytes(buffer)


def test_a_packet_of_any_length_comes_together_again() -> None:
    for length in range(1, 513):
        packet = bytes(7 * place & 0xFF for place in range(length))
        frames = frames_of(9, 3, Mode.PROCESS, packet)
        assert _rebuilt(frames) == packet
        assert all(len(frame.data) <= 8 for frame in frames)
        assert {frame.arbitration_id & 0xFF for frame in frames} == {9}
        short = min(length, 259)  # up to the first offset that is a multiple of 7 and needs two bytes
        assert len(frames) == (1 if length <= 6 else -(-short // 7) + -(-(length - short) // 6) + 1)


@pytest.mark.parametrize("packet", [b"", bytes(513)])
def test_a_packet_that_no_controller_takes_is_refused(packet: bytes) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        frames_of(9, 3, Mode.PROCESS, packet)
    assert refused.value.refusal is Refusal.LENGTH


@pytest.mark.parametrize("length", [0, 1, 2, 9])
def test_a_short_packet_has_one_to_six_bytes(length: int) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        decode_short(bytes(length))
    assert refused.value.refusal is Refusal.LENGTH


def test_a_mode_that_is_not_known_is_refused() -> None:
    with pytest.raises(FrameRefusedError) as refused:
        decode_short(b"\x05\x03\x01")
    assert refused.value.refusal is Refusal.RANGE


@fuzzed
@given(st.binary(max_size=10))
def test_a_short_packet_is_taken_as_it_was_sent_or_refused(data: bytes) -> None:
    with contextlib.suppress(FrameRefusedError):
        short = decode_short(data)
        assert short == ShortBuffer(data[0], Mode(data[1]), data[2:])
        assert frames_of(1, *short)[0].data == data


def assembled(frames: list[Frame], assembler: PacketAssembler | None = None) -> ShortBuffer | None:
    assembler = assembler or PacketAssembler()
    found = [assembler.take(PacketId(frame.arbitration_id >> 8), frame.data) for frame in frames]
    assert found[:-1] == [None] * (len(frames) - 1)
    return found[-1]


def test_a_long_packet_is_put_together_with_its_sender() -> None:
    for length in range(7, 513):
        packet = bytes(11 * place & 0xFF for place in range(length))
        assert assembled(frames_of(254, 9, Mode.PASS_ON, packet)) == ShortBuffer(9, Mode.PASS_ON, packet)


PACKET = bytes(range(1, 31))


@pytest.mark.parametrize("lost", range(5))
def test_a_packet_with_a_part_missing_is_refused_and_the_next_one_taken(lost: int) -> None:
    frames = frames_of(254, 9, Mode.PASS_ON, PACKET)
    assembler = PacketAssembler()
    with pytest.raises(FrameRefusedError):
        assembled(frames[:lost] + frames[lost + 1 :], assembler)
    assert assembled(frames, assembler) == ShortBuffer(9, Mode.PASS_ON, PACKET)


@pytest.mark.parametrize(
    ("data", "refusal"),
    [
        (b"\x09\x01\x00", Refusal.LENGTH),
        (b"\x09\x00\x00\x1e", Refusal.RANGE),
        (b"\x09\x01\x00\x1d", Refusal.LENGTH),
        (b"\x09\x01\x00\x1e", Refusal.CRC),
    ],
)
def test_a_packet_of_another_length_mode_or_crc_is_refused(data: bytes, refusal: Refusal) -> None:
    assembler = PacketAssembler()
    for frame in frames_of(254, 9, Mode.PASS_ON, PACKET)[:-1]:
        assembler.take(PacketId(frame.arbitration_id >> 8), frame.data)
    wrong = (crc16_xmodem(PACKET) ^ (refusal is Refusal.CRC)).to_bytes(2, "big") if len(data) == 4 else b""
    with pytest.raises(FrameRefusedError) as refused:
        assembler.take(PacketId.PROCESS_RX_BUFFER, data + wrong)
    assert refused.value.refusal is refusal


def test_nothing_is_no_packet() -> None:
    with pytest.raises(FrameRefusedError):
        PacketAssembler().take(PacketId.PROCESS_RX_BUFFER, bytes.fromhex("090100000000"))


@fuzzed
@given(st.lists(st.tuples(st.sampled_from([5, 6, 7]), st.binary(max_size=8)), max_size=90))
def test_no_frames_keep_more_than_the_longest_packet(frames: list[tuple[int, bytes]]) -> None:
    assembler = PacketAssembler()
    for command, data in frames:
        with contextlib.suppress(FrameRefusedError):
            assembler.take(PacketId(command), data)
        assert len(assembler._kept) <= 512
