# SPDX-License-Identifier: MIT
import socket
import struct
from collections.abc import Mapping

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.links.can_interfaces import (
    UNKNOWN,
    InterfaceState,
    encode_request,
    parse_reply,
    read_interface_state,
)
from segway_ecc.firmware_io.links.link import LinkState
from tests.fuzzing import fuzzed

# What Linux 6.1 answered for a serial-line CAN interface that is up at 500 kbit/s, and for a virtual one: the header,
# and of the attributes the one on the kind of link.
HEADER = "800300001000000001000000bf0200000000180103000000c100010000000000"
SLCAN = (
    "b00012000800010063616e001c000300000000000000000000000000000000000000000000000000880002002400010020a1070000000000"
    "000000000000000000000000000000000000000000000000080003000000000008000400000000000c000500000000000000000008000600"
    "0000000028000d0010270000204e000050c30000a086010048e8010090d0030020a1070000350c0040420f0008000f00000000000c001180"
    "0800010002000000"
)
VCAN = "10001200090001007663616e00000000"
KIND, DATA, LINKINFO = 1, 2, 18
BIT_TIMING, STATE, RESTART_MS, ERROR_COUNTERS, DATA_BIT_TIMING = 1, 4, 6, 8, 9


def _reply(attributes: str | bytes, header: str = HEADER) -> bytes:
    body = bytes.fromhex(attributes) if isinstance(attributes, str) else attributes
    message = bytearray(bytes.fromhex(header) + body)
    message[:4] = len(message).to_bytes(4, "little")
    return bytes(message)


def _attribute(number: int, value: bytes) -> bytes:
    return struct.pack("<HH", 4 + len(value), number) + value + bytes(-len(value) % 4)


def _can(controller: Mapping[int, bytes], kind: bytes = b"can\0") -> bytes:
    data = b"".join(_attribute(number, value) for number, value in controller.items())
    return _reply(_attribute(LINKINFO | 0x8000, _attribute(KIND, kind) + _attribute(DATA, data)))


def _u32(value: int) -> bytes:
    return value.to_bytes(4, "little")


def test_recorded_kernel_replies_are_read() -> None:
    slcan = parse_reply(_reply(SLCAN))
    assert slcan == InterfaceState("can", is_up=True, state=LinkState.ACTIVE, bitrate=500_000, restart_ms=0)
    assert str(slcan) == "active, 500000 bit/s, not restarted after bus-off"
    vcan = parse_reply(_reply(VCAN))
    assert vcan == InterfaceState("vcan", is_up=True)
    assert str(vcan) == "vcan: no controller that reports"


@pytest.mark.parametrize(
    ("number", "state"),
    [
        (0, LinkState.ACTIVE),
        (1, LinkState.WARNING),
        (2, LinkState.PASSIVE),
        (3, LinkState.BUS_OFF),
        (4, None),
        (5, None),
        (0xFFFFFFFF, None),
    ],
)
def test_every_state_of_a_controller_is_known(number: int, state: LinkState | None) -> None:
    found = parse_reply(_can({STATE: _u32(number), BIT_TIMING: _u32(250_000) + bytes(28)}))
    assert (found.state, found.bitrate) == (state, 250_000)
    assert str(found).startswith(f"{state or 'down'}, 250000 bit/s, ")


def test_counters_and_restart_time_are_read_where_the_driver_reports_them() -> None:
    found = parse_reply(
        _can({STATE: _u32(3), RESTART_MS: _u32(100), ERROR_COUNTERS: struct.pack("<HH", 256, 17), BIT_TIMING: _u32(0)})
    )
    assert found == InterfaceState("can", True, LinkState.BUS_OFF, None, 100, 256, 17)  # noqa: FBT003 - its fields in order
    assert str(found) == "bus-off, restarted 100 ms after bus-off"


def test_the_bit_rate_of_data_is_read_where_the_interface_carries_can_fd() -> None:
    rates = {BIT_TIMING: _u32(1_000_000) + bytes(28), DATA_BIT_TIMING: _u32(5_000_000) + bytes(28)}
    found = parse_reply(_can({STATE: _u32(0), **rates}))
    assert (found.bitrate, found.data_bitrate) == (1_000_000, 5_000_000)
    assert str(found) == "active, 1000000 bit/s, data at 5000000 bit/s, not restarted after bus-off"


@pytest.mark.parametrize("bitrate", [0, 0xFFFFFFFF])
def test_unset_bit_rate_is_not_reported(bitrate: int) -> None:
    found = parse_reply(_can({BIT_TIMING: _u32(bitrate), DATA_BIT_TIMING: _u32(bitrate)}))
    assert (found.bitrate, found.data_bitrate) == (None, None)


def test_numbers_of_other_kinds_of_interface_are_not_taken_for_a_controllers() -> None:
    assert parse_reply(_can({STATE: _u32(3)}, kind=b"vlan\0")) == InterfaceState("vlan", is_up=True)


def test_interface_that_is_down_reports_it() -> None:
    header = bytearray(bytes.fromhex(HEADER))
    header[24] &= 0xFE
    assert parse_reply(_reply(SLCAN, header.hex())).is_up is False


@pytest.mark.parametrize(
    "reply",
    [
        b"",
        bytes(32),
        bytes.fromhex(HEADER)[:31],
        _reply(SLCAN)[:-1],  # shorter than it says
        struct.pack("<IHHII", 36, 2, 0, 1, 0) + struct.pack("<i", -19) + bytes(16),  # the kernel's error message
        struct.pack("<IHHII", 31, 16, 0, 1, 0) + bytes(16),
    ],
)
def test_an_answer_that_is_none_is_unknown(reply: bytes) -> None:
    assert parse_reply(reply) == UNKNOWN
    assert str(UNKNOWN) == "unknown: no controller that reports"


@pytest.mark.parametrize("length", [0, 3, 200, 65535])
def test_an_attribute_with_a_false_length_ends_the_reading(length: int) -> None:
    false = struct.pack("<HH", length, LINKINFO) + bytes.fromhex(SLCAN)[4:]
    assert parse_reply(_reply(false)).kind == ""


REPLY = _reply(SLCAN)


@fuzzed
@given(st.dictionaries(st.integers(0, len(REPLY) - 1), st.integers(0, 255), max_size=4), st.integers(0, len(REPLY)))
def test_no_answer_however_damaged_raises(damage: dict[int, int], length: int) -> None:
    reply = bytearray(REPLY)
    for place, value in damage.items():
        reply[place] = value
    for damaged in (reply, reply[:length]):
        found = parse_reply(bytes(damaged))
        assert found.bitrate is None or 0 < found.bitrate < 0xFFFFFFFF
        assert str(found)


def test_the_question_names_the_interface() -> None:
    # nlmsghdr: 44 bytes, RTM_GETLINK, NLM_F_REQUEST; ifinfomsg of zeros; IFLA_IFNAME.
    assert encode_request("can0").hex() == ("2c000000120001000100000000000000" + "00" * 16 + "0900030063616e3000000000")
    assert len(encode_request("x" * 40)) == 16 + 16 + 4 + 16, "no name is longer than 15 letters"


def test_the_kernel_of_this_machine_answers() -> None:
    found = read_interface_state("lo")
    assert (found.kind, found.state, found.bitrate) == ("", None, None)
    assert found != UNKNOWN or not found.is_up
    assert read_interface_state("nosuch0") == UNKNOWN


def test_a_kernel_that_does_not_answer_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = socket.socketpair()
    with left, right, monkeypatch.context() as patched:
        patched.setattr(socket, "socket", lambda *_: left)
        assert read_interface_state("can0") == UNKNOWN
        assert right.recv(100) == encode_request("can0")
