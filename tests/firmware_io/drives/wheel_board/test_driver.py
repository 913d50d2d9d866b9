import math
from collections.abc import Sequence

import pytest

from firmware_io.drives.wheel_board.driver import WheelBoard
from firmware_io.drives.wheel_board.frames import (
    BoardSetup,
    BoardState,
    BoardStatus,
    FrameId,
    Payload,
    Wheel,
    WheelCommand,
    decode,
    encode,
)
from firmware_io.drives.wheel_board.limits import stale_after_ns
from firmware_io.errors import ArmingRefusedError
from firmware_io.hardware import Hardware
from firmware_io.links.link import Frame, Link

ZERO = (FrameId.WHEEL_COMMAND, WheelCommand(0.0, 0.0, enable=False))
SETUP = (FrameId.BOARD_SETUP, BoardSetup(0.05))
READY = BoardStatus(BoardState.DISABLED, 36.0, 0.05, 0)
MS = 1_000_000


class Bench:
    """A driver on a link in memory, a manual clock, and the board's side of the conversation."""

    def __init__(self, link: Link, arrived: list[Frame], sent: list[Frame], watchdog_s: float = 0.05) -> None:
        self.now_ns = 1_000 * MS
        self.driver = WheelBoard(link, watchdog_s, loop_period_s=0.01, now_ns=lambda: self.now_ns)
        self._arrived, self._sent = arrived, sent
        self._counters = dict.fromkeys(FrameId, 0)

    def tell(self, frame_id: FrameId, payload: Payload) -> None:
        """Let a frame of the board arrive now."""
        self._arrived.append(Frame(frame_id, encode(frame_id, payload, self._counters[frame_id]), self.now_ns))
        self._counters[frame_id] += 1

    def tell_status(self, status: BoardStatus = READY) -> None:
        """Let the board's status arrive now, and the driver hear it."""
        self.tell(FrameId.BOARD_STATUS, status)
        self.driver.exchange(None)

    def heard(self) -> list[tuple[int, Payload]]:
        """Everything the driver sent since the last call."""
        payloads = [(frame.arbitration_id, decode(frame.arbitration_id, frame.data)[0]) for frame in self._sent]
        self._sent.clear()
        return payloads

    def arm(self) -> None:
        """Arm the driver as far as the board is concerned."""
        self.tell_status()
        self.driver.arm()
        self.heard()

    def refusal(self) -> Sequence[str]:
        """Try to arm, and return why not."""
        with pytest.raises(ArmingRefusedError) as refused:
            self.driver.arm()
        assert str(refused.value) == "; ".join(refused.value.reasons)
        return refused.value.reasons


@pytest.fixture
def bench(link: Link, arrived: list[Frame], sent: list[Frame]) -> Bench:
    return Bench(link, arrived, sent)


def test_is_hardware_with_named_and_limited_ports(bench: Bench) -> None:
    hardware: Hardware = bench.driver
    assert list(hardware.signals) == ["left.angle", "left.velocity", "right.angle", "right.velocity"]
    assert list(hardware.commands) == ["left.voltage", "right.voltage"]
    assert hardware.limits == (30.0, 30.0)


def test_opening_sends_zero_disabled_and_then_the_watchdog(bench: Bench, events: list[str]) -> None:
    bench.driver.open()
    assert events == ["open", "send", "send"]
    assert bench.heard() == [ZERO, SETUP]


def test_before_anything_arrived_values_are_zero_infinitely_old_and_invalid(bench: Bench) -> None:
    sensors = bench.driver.exchange(None)
    assert sensors.values == (0.0, 0.0, 0.0, 0.0)
    assert sensors.ages == (math.inf,) * 4
    assert sensors.valid == (False,) * 4
    assert sensors.faults == ()


def test_each_wheel_has_its_own_values_ages_and_validity(bench: Bench) -> None:
    bench.tell(FrameId.LEFT_WHEEL, Wheel(9.0, 9.0))
    bench.tell(FrameId.LEFT_WHEEL, Wheel(1.5, -2.25))
    bench.now_ns += 31 * MS
    bench.tell(FrameId.RIGHT_WHEEL, Wheel(-3.5, 4.75))
    bench.now_ns += 2 * MS

    sensors = bench.driver.exchange(None)

    assert sensors.values == pytest.approx((1.5, -2.25, -3.5, 4.75))
    assert sensors.ages == pytest.approx((0.033, 0.033, 0.002, 0.002))
    assert sensors.valid == (False, False, True, True)


def test_a_wheel_is_stale_after_three_periods_of_the_slower_of_frame_and_loop(bench: Bench) -> None:
    bench.tell(FrameId.LEFT_WHEEL, Wheel(0.0, 0.0))
    bench.tell(FrameId.RIGHT_WHEEL, Wheel(0.0, 0.0))
    bench.now_ns += 30 * MS
    assert bench.driver.exchange(None).valid == (True,) * 4
    bench.now_ns += 1
    assert bench.driver.exchange(None).valid == (False,) * 4


@pytest.mark.parametrize(
    ("frame_id", "loop_period_s", "expected_ns"),
    [
        (FrameId.LEFT_WHEEL, 0.001, 15 * MS),
        (FrameId.RIGHT_WHEEL, 0.01, 30 * MS),
        (FrameId.BOARD_STATUS, 0.01, 60 * MS),
        (FrameId.BOARD_STATUS, 0.1, 300 * MS),
    ],
)
def test_staleness_counts_in_periods(frame_id: FrameId, loop_period_s: float, expected_ns: int) -> None:
    assert stale_after_ns(frame_id, loop_period_s) == expected_ns


def test_a_damaged_frame_does_not_make_a_value_younger(bench: Bench, arrived: list[Frame]) -> None:
    bench.tell(FrameId.LEFT_WHEEL, Wheel(1.0, 1.0))
    bench.driver.exchange(None)
    bench.now_ns += 10 * MS
    bench.tell(FrameId.LEFT_WHEEL, Wheel(2.0, 2.0))
    arrived[-1] = arrived[-1]._replace(data=bytes((arrived[-1].data[0] ^ 4, *arrived[-1].data[1:])))

    sensors = bench.driver.exchange(None)

    assert sensors.values[0] == pytest.approx(1.0)
    assert sensors.ages[0] == pytest.approx(0.010)
    assert bench.driver.health["refused.crc"] == "1"


def test_a_silent_board_refuses_arming_with_the_bus_to_look_at(bench: Bench) -> None:
    (reason,) = bench.refusal()
    assert reason == "the wheel board does not answer on memory; is it powered and on this bus?"


def test_a_board_that_fell_silent_refuses_arming_after_three_status_periods(bench: Bench) -> None:
    bench.tell_status()
    bench.now_ns += 60 * MS + 1
    (reason,) = bench.refusal()
    assert "does not answer" in reason

    bench.tell_status()
    bench.now_ns += 60 * MS
    bench.driver.arm()


@pytest.mark.parametrize("watchdog_s", [0.0, 0.019, 0.051, 1.0])
def test_a_watchdog_off_or_out_of_range_refuses_arming(bench: Bench, watchdog_s: float) -> None:
    bench.tell_status(READY._replace(watchdog_s=watchdog_s))
    (reason,) = bench.refusal()
    assert f"the board's watchdog stands at {watchdog_s:g} s, allowed is 0.02 to 0.05 s" in reason
    assert "does its firmware take BOARD_SETUP?" in reason


@pytest.mark.parametrize("watchdog_s", [0.02, 0.05])
def test_the_ends_of_the_watchdogs_range_are_allowed(bench: Bench, watchdog_s: float) -> None:
    bench.tell_status(READY._replace(watchdog_s=watchdog_s))
    bench.driver.arm()


@pytest.mark.parametrize("state", [BoardState.WATCHDOG, BoardState.FAULT])
def test_a_board_that_switched_itself_off_refuses_arming(bench: Bench, state: BoardState) -> None:
    bench.tell_status(READY._replace(state=state))
    assert bench.refusal() == (f"the board reports {state.name}; if it stays, switch it off and on",)

    bench.tell_status(READY)
    bench.driver.arm()


def test_every_reason_is_told_at_once(bench: Bench) -> None:
    bench.tell_status(BoardStatus(BoardState.FAULT, 36.0, 0.0, 0))
    assert len(bench.refusal()) == 2


def test_a_refused_arming_leaves_the_motors_off(bench: Bench) -> None:
    bench.refusal()
    bench.driver.exchange((1.0, 2.0))
    assert bench.heard() == [ZERO]


def test_voltages_and_enable_leave_only_while_armed(bench: Bench) -> None:
    bench.driver.exchange((1.0, -2.0))
    assert bench.heard() == [ZERO]

    bench.arm()
    bench.driver.exchange((1.0, -2.0))
    ((frame_id, command),) = bench.heard()
    assert frame_id == FrameId.WHEEL_COMMAND
    assert isinstance(command, WheelCommand)
    assert (command.left_voltage, command.right_voltage) == pytest.approx((1.0, -2.0))
    assert command.enable

    bench.driver.disarm()
    bench.heard()
    bench.driver.exchange((1.0, -2.0))
    assert bench.heard() == [ZERO]


def test_disarming_sends_zero_at_once(bench: Bench) -> None:
    bench.arm()
    bench.driver.disarm()
    assert bench.heard() == [ZERO]


def test_closing_sends_zero_before_the_link_closes(bench: Bench, events: list[str]) -> None:
    bench.arm()
    events.clear()
    bench.driver.close()
    assert events == ["send", "close"]
    assert bench.heard() == [ZERO]


def test_an_exchange_without_commands_sends_nothing_and_still_listens(bench: Bench) -> None:
    bench.arm()
    bench.tell(FrameId.LEFT_WHEEL, Wheel(7.0, 0.0))
    assert bench.driver.exchange(None).values[0] == pytest.approx(7.0)
    assert bench.heard() == []


@pytest.mark.parametrize("state", [BoardState.WATCHDOG, BoardState.FAULT])
def test_a_board_that_switches_itself_off_while_armed_is_a_fault_until_disarmed(
    bench: Bench, state: BoardState
) -> None:
    bench.arm()
    assert bench.driver.exchange((0.0, 0.0)).faults == ()
    bench.tell(FrameId.BOARD_STATUS, READY._replace(state=state))
    assert bench.driver.exchange((0.0, 0.0)).faults == (f"the wheel board switched its motors off: {state.name}",)

    bench.driver.disarm()
    assert bench.driver.exchange(None).faults == ()


def test_a_board_whose_status_falls_silent_while_armed_is_a_fault(bench: Bench) -> None:
    bench.arm()
    bench.now_ns += 60 * MS
    assert bench.driver.exchange((0.0, 0.0)).faults == ()

    bench.now_ns += 1 * MS
    assert bench.driver.exchange((0.0, 0.0)).faults == ("the wheel board's status is too old: 61 ms",)


def test_a_board_that_was_switched_on_later_gets_its_watchdog_until_it_has_it(bench: Bench) -> None:
    bench.driver.open()
    bench.heard()

    bench.tell_status(READY._replace(watchdog_s=0.02))
    assert bench.heard() == [SETUP]
    bench.tell_status(READY._replace(watchdog_s=0.02))
    assert bench.heard() == [SETUP]
    bench.tell_status(READY)
    assert bench.heard() == []


def test_the_watchdog_is_left_alone_while_armed(bench: Bench) -> None:
    bench.arm()
    bench.tell_status(READY._replace(watchdog_s=0.02))
    assert bench.heard() == []


@pytest.mark.parametrize("watchdog_s", [0.0203, 0.0225, 0.0333, 0.0475])
def test_a_watchdog_between_whole_milliseconds_is_sent_once_and_not_for_ever(
    link: Link, arrived: list[Frame], sent: list[Frame], watchdog_s: float
) -> None:
    bench = Bench(link, arrived, sent, watchdog_s)
    bench.driver.open()
    (_, taken) = bench.heard()[1]
    assert isinstance(taken, BoardSetup)

    bench.tell_status(READY._replace(watchdog_s=taken.watchdog_s))

    assert bench.heard() == []


def test_health_has_every_count_as_text(bench: Bench, link: Link, arrived: list[Frame]) -> None:
    for index, name in enumerate(link.counters.as_text(), start=1):
        setattr(link.counters, name, index)
    for _ in range(5):
        bench.tell(FrameId.BOARD_STATUS, BoardStatus(BoardState.FAULT, 24.5, 0.05, 77))
    first, _, _, _, last = arrived
    arrived[:] = [first, last, last, last._replace(data=b"short")]
    bench.driver.exchange(None)

    counts = ("sent", "received", "send_dropped", "error_frames", "remote_frames", "undecodable")
    assert bench.driver.health == {
        "link": "memory",
        **{f"link.{name}": str(index) for index, name in enumerate(counts, start=1)},
        "link.lost": "3",
        "refused.counter": "1",
        "refused.length": "1",
        "board.state": "FAULT",
        "board.bus_voltage_v": "24.500",
        "board.watchdog_s": "0.050",
        "board.refused_frames": "77",
    }
