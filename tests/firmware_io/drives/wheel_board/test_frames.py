# SPDX-License-Identifier: MIT
import math
from collections.abc import Callable, Mapping
from importlib.resources import as_file, files
from typing import Any

import cantools
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    AngularVelocity,
    BoardSession,
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    LinearAcceleration,
    Payload,
    Wheel,
    WheelCommand,
    decode,
    encode,
)
from segway_ecc.firmware_io.integrity import FrameRefusedError, Refusal
from tests.fuzzing import fuzzed

Crc = Callable[[bytes], int]
Signals = dict[str, float]


with as_file(files("segway_ecc.firmware_io.drives.wheel_board") / "wheel_board.dbc") as _path:
    DBC: Any = cantools.database.load_file(_path)

PROTECTION = {"Counter", "Crc"}
TYPES: Mapping[FrameId, type[Payload]] = {
    FrameId.WHEEL_COMMAND: WheelCommand,
    FrameId.BOARD_SETUP: BoardSetup,
    FrameId.LEFT_WHEEL: Wheel,
    FrameId.RIGHT_WHEEL: Wheel,
    FrameId.IMU_GYRO: AngularVelocity,
    FrameId.IMU_ACCELERATION: LinearAcceleration,
    FrameId.BOARD_STATUS: BoardStatus,
    FrameId.BOARD_SESSION: BoardSession,
}
SAMPLES: Mapping[FrameId, Payload] = {
    FrameId.WHEEL_COMMAND: WheelCommand(12.345, -6.789, enable=True),
    FrameId.BOARD_SETUP: BoardSetup(0.05),
    FrameId.LEFT_WHEEL: Wheel(-1234.5678, 98.76),
    FrameId.RIGHT_WHEEL: Wheel(0.0, 0.0),
    FrameId.IMU_GYRO: AngularVelocity(-31.999, 0.001, 4.5),
    FrameId.IMU_ACCELERATION: LinearAcceleration(0.005, -159.995, 9.805),
    FrameId.BOARD_STATUS: BoardStatus(BoardState.WATCHDOG, 36.0, 0.05, 255),
    FrameId.BOARD_SESSION: BoardSession(0xFEDCBA98, 0x7654),
}


def _signals(payload: Payload) -> Signals:
    match payload:
        case WheelCommand(left, right, enable):
            return {"LeftVoltage": left, "RightVoltage": right, "Enable": int(enable)}
        case BoardSetup(watchdog_s):
            return {"Watchdog": watchdog_s}
        case Wheel(angle, velocity):
            return {"Angle": angle, "Velocity": velocity}
        case AngularVelocity(x, y, z) | LinearAcceleration(x, y, z):
            return {"X": x, "Y": y, "Z": z}
        case BoardStatus(state, bus_voltage, watchdog_s, refused):
            return {"State": state, "BusVoltage": bus_voltage, "Watchdog": watchdog_s, "RefusedFrames": refused}
        case BoardSession(number, epoch):
            return {"Session": number, "Epoch": epoch}


def _payload(frame_id: FrameId, signals: Mapping[str, Any]) -> Payload:
    """Build the payload from values in the DBC's order, which is also the order of the fields."""
    message = DBC.get_message_by_name(frame_id.name)
    kinds = {"Enable": bool, "State": BoardState}
    values = {name: kinds[name](value) if name in kinds else value for name, value in signals.items()}
    return TYPES[frame_id](*(values[signal.name] for signal in message.signals if signal.name not in PROTECTION))


def _draw(frame_id: FrameId) -> st.SearchStrategy[tuple[FrameId, Signals]]:
    """Values anywhere in the DBC's ranges, for one frame."""
    values: dict[str, st.SearchStrategy[float]] = {}
    for signal in DBC.get_message_by_name(frame_id.name).signals:
        if signal.name in PROTECTION:
            continue
        low, high = signal.minimum, signal.maximum
        values[signal.name] = st.integers(low, high) if signal.scale == 1 else st.floats(low, high)
    return st.tuples(st.just(frame_id), st.fixed_dictionaries(values))


STEPS = {
    frame_id: {s.name: s.scale for s in DBC.get_message_by_name(frame_id.name).signals if s.name not in PROTECTION}
    for frame_id in FrameId
}
IN_RANGE = st.one_of([_draw(frame_id) for frame_id in FrameId])
COUNTERS = st.integers(0, 15)


def _seal(reference_crc: Crc, frame_id: int, body: bytes) -> bytes:
    return body + bytes((reference_crc(body + frame_id.to_bytes(2, "little")),))


def _by_cantools(reference_crc: Crc, frame_id: FrameId, signals: Signals, counter: int) -> bytes:
    raw = DBC.encode_message(frame_id.name, {**signals, "Counter": counter, "Crc": 0}, strict=False)
    return _seal(reference_crc, frame_id, raw[:7])


@fuzzed
@given(IN_RANGE, COUNTERS)
def test_bytes_and_values_are_cantools_and_keep_every_value_to_half_a_step(
    reference_crc: Crc, drawn: tuple[FrameId, Signals], counter: int
) -> None:
    frame_id, signals = drawn
    data = _by_cantools(reference_crc, frame_id, signals, counter)
    theirs = DBC.decode_message(frame_id.name, data, decode_choices=False)

    assert encode(frame_id, _payload(frame_id, signals), counter) == data
    payload, decoded_counter = decode(frame_id, data)

    assert type(payload) is TYPES[frame_id]
    decoded = _signals(payload)
    assert decoded_counter == theirs["Counter"] == counter
    assert theirs["Crc"] == data[7]
    for name, step in STEPS[frame_id].items():
        assert decoded[name] == pytest.approx(theirs[name], rel=1e-15)
        assert abs(decoded[name] - signals[name]) <= 0.500001 * step


@pytest.mark.parametrize("frame_id", FrameId)
def test_counter_and_crc_are_at_the_dbc_positions(reference_crc: Crc, frame_id: FrameId) -> None:
    message = DBC.get_message_by_name(frame_id.name)
    places = {s.name: (s.start, s.length, s.is_signed) for s in message.signals if s.name in PROTECTION}
    assert places == {"Counter": (48, 4, False), "Crc": (56, 8, False)}

    data = encode(frame_id, SAMPLES[frame_id], 16 + 11)
    assert data[6] == 11, "counters are taken modulo 16"
    assert data[7] == reference_crc(data[:7] + bytes((frame_id & 0xFF, frame_id >> 8)))


BOUNDS = [
    pytest.param(frame_id, signal.name, bound, way, id=f"{frame_id.name}.{signal.name}-{bound:g}")
    for frame_id in FrameId
    for signal in DBC.get_message_by_name(frame_id.name).signals
    if signal.scale != 1
    for bound, way in ((signal.minimum, -1), (signal.maximum, 1))
]


@pytest.mark.parametrize(("frame_id", "name", "bound", "way"), BOUNDS)
def test_the_dbcs_bounds_are_taken_and_the_next_number_is_not(
    reference_crc: Crc, frame_id: FrameId, name: str, bound: float, way: int
) -> None:
    sample = _signals(SAMPLES[frame_id])
    signal = DBC.get_message_by_name(frame_id.name).get_signal_by_name(name)
    at_bound = {**sample, name: bound}

    data = encode(frame_id, _payload(frame_id, at_bound), 0)
    assert _signals(decode(frame_id, data)[0])[name] == bound

    beyond = {**sample, name: math.nextafter(bound, way * math.inf)}
    with pytest.raises(FrameRefusedError) as refused:
        encode(frame_id, _payload(frame_id, beyond), 0)
    assert refused.value.refusal is Refusal.RANGE

    if bound == 0 and not signal.is_signed:
        return  # no bit pattern stands for less
    step_beyond = {**sample, name: bound + way * signal.scale}
    with pytest.raises(FrameRefusedError) as refused:
        decode(frame_id, _by_cantools(reference_crc, frame_id, step_beyond, 0))
    assert refused.value.refusal is Refusal.RANGE


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize(("frame_id", "name"), {(p.values[0], p.values[1]): None for p in BOUNDS})
def test_what_is_no_number_in_range_is_never_encoded(frame_id: FrameId, name: str, value: float) -> None:
    with pytest.raises(FrameRefusedError, match=f"0x{frame_id:03X} refused: range"):
        encode(frame_id, _payload(frame_id, {**_signals(SAMPLES[frame_id]), name: value}), 0)


@pytest.mark.parametrize("state", range(4, 8))
def test_a_state_without_a_name_is_refused(reference_crc: Crc, state: int) -> None:
    body = bytes((state, *encode(FrameId.BOARD_STATUS, SAMPLES[FrameId.BOARD_STATUS], 0)[1:7]))
    with pytest.raises(FrameRefusedError) as refused:
        decode(FrameId.BOARD_STATUS, _seal(reference_crc, FrameId.BOARD_STATUS, body))
    assert refused.value.refusal is Refusal.RANGE


@pytest.mark.parametrize("frame_id", FrameId)
@pytest.mark.parametrize("counter", [0, 15])
def test_bits_that_the_dbc_does_not_name_are_ignored(reference_crc: Crc, frame_id: FrameId, counter: int) -> None:
    # Not enabled, so that an enable bit taken from its neighbours would show.
    payload = WheelCommand(1.0, 2.0, enable=False) if frame_id == FrameId.WHEEL_COMMAND else SAMPLES[frame_id]
    signals = DBC.get_message_by_name(frame_id.name).signals
    named = sum(((1 << signal.length) - 1) << signal.start for signal in signals)
    data = encode(frame_id, payload, counter)
    clear = int.from_bytes(data, "little")
    filled = (clear | ~named & (1 << 56) - 1).to_bytes(8, "little")

    assert filled != data
    assert decode(frame_id, _seal(reference_crc, frame_id, filled[:7])) == decode(frame_id, data)


def test_refused_frames_are_reported_modulo_256() -> None:
    status = BoardStatus(BoardState.DISABLED, 0.0, 0.0, 0x1FE)
    assert decode(FrameId.BOARD_STATUS, encode(FrameId.BOARD_STATUS, status, 0))[0] == replace(
        status, refused_frames=0xFE
    )


def _check_what_decode_makes(identifier: int, data: bytes) -> None:
    try:
        payload, counter = decode(identifier, data)
    except FrameRefusedError:
        return
    assert 0 <= counter <= 15
    message = DBC.get_message_by_frame_id(identifier)
    for name, value in _signals(payload).items():
        signal = message.get_signal_by_name(name)
        assert math.isfinite(value)
        assert signal.minimum <= value <= signal.maximum


@fuzzed
@given(st.integers(0, 0x1FFFFFFF) | st.sampled_from(FrameId), st.binary(max_size=72))
def test_arbitrary_bytes_are_refused_or_sound(identifier: int, data: bytes) -> None:
    _check_what_decode_makes(identifier, data)


@fuzzed
@given(st.sampled_from(FrameId), st.binary(min_size=7, max_size=7))
@example(FrameId.WHEEL_COMMAND, b"\x00\x80\x00\x80\xff\xff\xff")
@example(FrameId.LEFT_WHEEL, b"\x00\x00\x00\x80\x00\x80\xff")
@example(FrameId.BOARD_STATUS, b"\xff" * 7)
def test_arbitrary_bodies_under_a_right_crc_are_refused_or_sound(
    reference_crc: Crc, frame_id: FrameId, body: bytes
) -> None:
    _check_what_decode_makes(frame_id, _seal(reference_crc, frame_id, body))


@pytest.mark.parametrize("counter", [0, 7, 15])
@pytest.mark.parametrize("frame_id", FrameId)
def test_every_flipped_bit_is_refused(frame_id: FrameId, counter: int) -> None:
    data = encode(frame_id, SAMPLES[frame_id], counter)
    whole = int.from_bytes(data, "big")
    for bit in range(64):
        with pytest.raises(FrameRefusedError) as refused:
            decode(frame_id, (whole ^ (1 << bit)).to_bytes(8, "big"))
        assert refused.value.refusal is Refusal.CRC


@pytest.mark.parametrize("frame_id", FrameId)
def test_a_frame_under_any_other_standard_identifier_is_refused(frame_id: FrameId) -> None:
    data = encode(frame_id, SAMPLES[frame_id], 3)
    for other in set(range(2048)) - {frame_id}:
        with pytest.raises(FrameRefusedError) as refused:
            decode(other, data)
        assert refused.value.refusal is (Refusal.CRC if other in set(FrameId) else Refusal.UNKNOWN)


def test_every_identifier_and_length_that_is_not_ours_is_refused() -> None:
    for identifier in range(2048):
        known = identifier in set(FrameId)
        for length in range(8 if known else 9):
            with pytest.raises(FrameRefusedError) as refused:
                decode(identifier, bytes(length))
            assert refused.value.refusal is (Refusal.LENGTH if known else Refusal.UNKNOWN)


@pytest.mark.parametrize("frame_id", FrameId)
def test_a_frame_with_something_behind_it_is_refused(frame_id: FrameId) -> None:
    with pytest.raises(FrameRefusedError) as refused:
        decode(frame_id, encode(frame_id, SAMPLES[frame_id], 0) + b"\0")
    assert refused.value.refusal is Refusal.LENGTH
