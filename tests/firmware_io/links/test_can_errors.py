# SPDX-License-Identifier: MIT
import pytest
from hypothesis import given
from hypothesis import strategies as st

from segway_ecc.firmware_io.links.can_errors import BusError, BusErrors, decode_error
from segway_ecc.firmware_io.links.link import LinkState
from tests.fuzzing import fuzzed

CAUSES = {
    "tx_timeout",
    "lost_arbitration",
    "controller",
    "rx_overflow",
    "tx_overflow",
    "protocol",
    "transceiver",
    "no_acknowledgement",
    "bus_off",
    "bus_error",
    "restarted",
    "other",
}


def _data(*pairs: tuple[int, int]) -> bytes:
    data = bytearray(8)
    for index, value in pairs:
        data[index] = value
    return bytes(data)


@pytest.mark.parametrize(
    ("classes", "cause"),
    [
        (0x001, "tx_timeout"),
        (0x002, "lost_arbitration"),
        (0x004, "controller"),
        (0x008, "protocol"),
        (0x010, "transceiver"),
        (0x020, "no_acknowledgement"),
        (0x080, "bus_error"),
        (0x200, "other"),
        (0, "other"),
        (0x1FFFFC00, "other"),
    ],
)
def test_a_class_without_more_is_a_cause_and_no_state(classes: int, cause: str) -> None:
    error = decode_error(classes, bytes(8))
    assert (error.causes, error.state) == ((cause,), None)


@pytest.mark.parametrize(
    ("detail", "state"),
    [
        (0x04, LinkState.WARNING),
        (0x08, LinkState.WARNING),
        (0x0C, LinkState.WARNING),
        (0x10, LinkState.PASSIVE),
        (0x20, LinkState.PASSIVE),
        (0x24, LinkState.PASSIVE),  # passive in sending, warned in receiving
        (0x40, LinkState.ACTIVE),
        (0x00, None),
        (0x80, None),
    ],
)
def test_the_controllers_state_is_the_worse_of_both_ways(detail: int, state: LinkState | None) -> None:
    assert decode_error(0x004, _data((1, detail))) == BusError(("controller",), state)
    assert decode_error(0x008, _data((1, detail))).state is None, "the byte means this in one class only"


def test_a_queue_of_the_controller_that_ran_over_is_named() -> None:
    assert decode_error(0x004, _data((1, 0x01))).causes == ("controller", "rx_overflow")
    assert decode_error(0x004, _data((1, 0x03))).causes == ("controller", "rx_overflow", "tx_overflow")
    assert decode_error(0x008, _data((1, 0x03))).causes == ("protocol",)


def test_bus_off_takes_precedence_in_an_error_frame() -> None:
    error = decode_error(0x044, _data((1, 0x20)))
    assert (error.causes, error.state) == (("controller", "bus_off"), LinkState.BUS_OFF)


def test_restart_makes_the_controller_active_unless_the_frame_has_a_state() -> None:
    assert decode_error(0x100, bytes(8)) == BusError(("restarted",), LinkState.ACTIVE)
    assert decode_error(0x104, _data((1, 0x08))).state is LinkState.WARNING


def test_error_counters_are_read_where_flagged() -> None:
    data = _data((6, 250), (7, 3))
    assert decode_error(0x208, data)[2:] == (250, 3)
    assert decode_error(0x008, data)[2:] == (None, None)


@fuzzed
@given(classes=st.integers(0, 0x1FFFFFFF), data=st.binary(max_size=16))
def test_any_error_frame_is_read(classes: int, data: bytes) -> None:
    error = decode_error(classes, data)
    assert error.causes
    assert set(error.causes) <= CAUSES
    assert (error.state is LinkState.BUS_OFF) == bool(classes & 0x40)
    assert (error.tec is None) == (error.rec is None) == (not classes & 0x200)
    assert all(0 <= level <= 255 for level in (error.tec, error.rec) if level is not None)


def test_what_is_known_of_a_bus_is_the_newest_of_each() -> None:
    errors = BusErrors()
    assert (errors.state, errors.as_text()) == (LinkState.ACTIVE, {})
    errors.take_frame(0x204, _data((1, 0x20), (6, 128), (7, 7)))
    errors.take_frame(0x020, bytes(8))
    errors.take_frame(0x020, bytes(8))
    assert errors.state is LinkState.PASSIVE
    assert errors.as_text() == {
        "tec": "128",
        "rec": "7",
        "errors.controller": "1",
        "errors.no_acknowledgement": "2",
    }


def test_known_values_replace_only_themselves() -> None:
    errors = BusErrors()
    errors.learn(LinkState.WARNING, 96, 1)
    errors.learn(None, None, None)
    assert (errors.state, errors.tec, errors.rec) == (LinkState.WARNING, 96, 1)
    errors.learn(LinkState.BUS_OFF, 0, 0)
    assert (errors.state, errors.tec, errors.rec) == (LinkState.BUS_OFF, 0, 0)
    errors.take_frame(0x001, b"")
    errors.begin()
    assert (errors.state, errors.tec, errors.rec) == (LinkState.ACTIVE, None, None)
    assert errors.counts == {"tx_timeout": 1}
