# SPDX-License-Identifier: MIT
"""The CAN codec; expected bytes are worked out by hand from the scales of VESC's protocol description."""

import contextlib
import itertools
import math
import random
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.drives.vesc.frames import (
    Current,
    CurrentLimits,
    DelayedCurrent,
    Duty,
    PacketId,
    Payload,
    Ping,
    Pong,
    Position,
    RelativeCurrent,
    Speed,
    Status,
    Status5,
    addressed,
    arbitration_id,
    decode,
    encode,
    frame_of,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame
from tests.fuzzing import fuzzed

CASES: list[tuple[PacketId, int, Payload, str]] = [
    (PacketId.SET_DUTY, 0, Duty(-0.5), "FFFF3CB0"),
    (PacketId.SET_CURRENT, 1, Current(51.0), "0000C738"),
    (PacketId.SET_CURRENT, 1, DelayedCurrent(-1.0, 0.25), "FFFFFC1800FA"),
    (PacketId.SET_CURRENT_BRAKE, 2, Current(1.0), "000003E8"),
    (PacketId.SET_RPM, 3, Speed(-1000), "FFFFFC18"),
    (PacketId.SET_POS, 4, Position(90.0), "055D4A80"),
    (PacketId.STATUS, 9, Status(7000, -12.3, 0.25), "00001B58FF8500FA"),
    (PacketId.SET_CURRENT_REL, 10, RelativeCurrent(1.0), "000186A0"),
    (PacketId.SET_CURRENT_BRAKE_REL, 11, RelativeCurrent(0.5), "0000C350"),
    (PacketId.SET_CURRENT_HANDBRAKE, 12, Current(2.0), "000007D0"),
    (PacketId.SET_CURRENT_HANDBRAKE_REL, 13, RelativeCurrent(0.25), "000061A8"),
    (PacketId.PING, 17, Ping(200), "C8"),
    (PacketId.PONG, 18, Pong(23, 1), "1701"),
    (PacketId.CONF_CURRENT_LIMITS, 21, CurrentLimits(-10.0, 20.0), "FFFFD8F000004E20"),
    (PacketId.CONF_STORE_CURRENT_LIMITS, 22, CurrentLimits(-1.0, 1.0), "FFFFFC18000003E8"),
    (PacketId.CONF_CURRENT_LIMITS_IN, 23, CurrentLimits(-2.0, 2.0), "FFFFF830000007D0"),
    (PacketId.CONF_STORE_CURRENT_LIMITS_IN, 24, CurrentLimits(0.0, 3.0), "0000000000000BB8"),
    (PacketId.STATUS_5, 27, Status5(-42, 36.5), "FFFFFFD6016D0000"),
]
NUMBERS = sorted({number for _, number, _, _ in CASES})


@pytest.mark.parametrize(("command", "number", "payload", "data"), CASES)
def test_bytes_are_the_protocols(command: PacketId, number: int, payload: Payload, data: str) -> None:
    assert command == number
    assert encode(command, payload).hex().upper() == data
    decoded = decode(number, bytes.fromhex(data))
    assert type(decoded) is type(payload)
    assert decoded == pytest.approx(payload)


def test_every_command_whose_values_are_used_is_among_the_cases() -> None:
    packets = {c for c in PacketId if c.name.startswith(("FILL_", "PROCESS_"))}
    unused = {PacketId.STATUS_2, PacketId.STATUS_3, PacketId.STATUS_4, PacketId.STATUS_6}
    assert {case[0] for case in CASES} == set(PacketId) - packets - unused


def test_the_published_frame_is_met() -> None:
    """VESC's description of its CAN protocol: 51 A for the controller 23."""
    assert frame_of(PacketId.SET_CURRENT, 23, Current(51.0)) == Frame(
        0x117, bytes.fromhex("0000C738"), 0, is_extended=True
    )


def test_bytes_that_are_reserved_are_passed_over() -> None:
    assert decode(PacketId.STATUS_5, bytes.fromhex("00000001000AFFFF")) == Status5(1, 1.0)


@pytest.mark.parametrize(
    ("command", "highest", "beyond"),
    [
        (PacketId.SET_CURRENT, Current(2_147_483.647), Current(2_147_483.648)),
        (PacketId.SET_CURRENT, Current(-2_147_483.648), Current(-2_147_483.649)),
        (PacketId.SET_RPM, Speed(2**31 - 1), Speed(2**31)),
        (PacketId.STATUS, Status(0, 3276.7, 0.0), Status(0, 3276.8, 0.0)),
        (PacketId.STATUS, Status(0, -3276.8, -32.768), Status(0, 0.0, -32.769)),
        (PacketId.STATUS_5, Status5(-(2**31), 0.0), Status5(-(2**31) - 1, 0.0)),
        (PacketId.PING, Ping(255), Ping(256)),
        (PacketId.PING, Ping(0), Ping(-1)),
        (PacketId.SET_CURRENT, DelayedCurrent(0.0, 32.767), DelayedCurrent(0.0, 32.768)),
    ],
)
def test_a_value_that_does_not_fit_is_refused_and_never_wrapped(
    command: PacketId, highest: Payload, beyond: Payload
) -> None:
    assert decode(command, encode(command, highest)) == pytest.approx(highest)
    with pytest.raises(FrameRefusedError, match="range") as refused:
        encode(command, beyond)
    assert refused.value.refusal is Refusal.RANGE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_is_refused(value: float) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        encode(PacketId.SET_CURRENT, Current(value))
    assert refused.value.refusal is Refusal.RANGE


@pytest.mark.parametrize(
    ("command", "payload"),
    [
        (PacketId.SET_CURRENT, Duty(0.1)),
        (PacketId.SET_CURRENT_BRAKE, DelayedCurrent(1.0, 0.1)),
        (PacketId.PROCESS_RX_BUFFER, Current(1.0)),
    ],
)
def test_a_payload_of_another_command_is_refused(command: PacketId, payload: Payload) -> None:
    with pytest.raises(FrameRefusedError, match=r".* refused: unknown") as refused:
        encode(command, payload)
    assert refused.value.refusal is Refusal.UNKNOWN


@pytest.mark.parametrize("length", range(9))
def test_each_command_has_its_lengths_and_no_other(length: int) -> None:
    for number in range(256):
        lengths = {len(bytes.fromhex(data)) for _, n, _, data in CASES if n == number}
        if length in lengths:
            decode(number, bytes(length))
            continue
        with pytest.raises(FrameRefusedError) as refused:
            decode(number, bytes(length))
        assert refused.value.refusal is (Refusal.LENGTH if lengths else Refusal.UNKNOWN)


@fuzzed
@given(st.binary(max_size=8))
def test_decoding_gives_finite_values_that_encode_to_the_same_bytes_or_refuses(data: bytes) -> None:
    for number in NUMBERS:
        with contextlib.suppress(FrameRefusedError):
            payload = decode(number, data)
            assert all(math.isfinite(value) for value in payload)
            again = encode(PacketId(number), payload)
            assert again == (data[:6] + b"\0\0" if number == PacketId.STATUS_5 else data)


@fuzzed
@given(st.floats())
def test_encoding_keeps_a_value_within_half_a_step_or_refuses(value: float) -> None:
    for command, _, example, _ in CASES:
        with contextlib.suppress(FrameRefusedError):
            kind: Any = type(example)
            payload = kind._make([value] * len(example))
            decoded = decode(command, encode(command, payload))
            assert all(abs(found - value) <= 0.5 for found in decoded)


@given(st.integers(0, 255), st.sampled_from(list(PacketId)))
def test_an_identifier_is_the_command_and_the_controller(controller_id: int, command: PacketId) -> None:
    identifier = arbitration_id(command, controller_id)
    assert identifier == 256 * command + controller_id
    assert addressed(Frame(identifier, b"", is_extended=True)) == (command, controller_id)
    assert addressed(Frame(identifier, b"", is_extended=False)) is None
    assert addressed(Frame(identifier | 1 << 16, b"", is_extended=True)) is None


def test_other_identifiers_are_nobodys() -> None:
    numbers = set(PacketId)
    chance = random.Random(1)  # noqa: S311 - a test's chance, not a secret
    for identifier in itertools.chain(range(0x10000), (chance.getrandbits(29) for _ in range(10_000))):
        found = addressed(Frame(identifier, b"", is_extended=True))
        assert (found is not None) == (identifier >> 8 in numbers)
        assert addressed(Frame(identifier & 0x7FF, b"")) is None
