# SPDX-License-Identifier: MIT
import math
from collections.abc import Callable, Sequence

import pytest
from msgspec.structs import astuple, replace

from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.wheel_board.driver import WheelBoard
from segway_ecc.firmware_io.drives.wheel_board.frames import (
    AngularVelocity,
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
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame, Link

ZERO = (0x110, WheelCommand(0.0, 0.0, enable=False))
ZERO_ENABLED = (0x110, WheelCommand(0.0, 0.0, enable=True))
SETUP = (0x111, BoardSetup(0.05))
READY = BoardStatus(BoardState.DISABLED, 36.0, 0.05, 0)
MS = 1_000_000
OFF_BY_ITSELF = [BoardState.WATCHDOG, BoardState.FAULT]
SUPPLY = {"supply.voltage": "V"}
WHEELS = {"left.angle": "rad", "left.velocity": "rad/s", "right.angle": "rad", "right.velocity": "rad/s"}
IMU = {
    "imu.angular_velocity_x": "rad/s",
    "imu.angular_velocity_y": "rad/s",
    "imu.angular_velocity_z": "rad/s",
    "imu.linear_acceleration_x": "m/s2",
    "imu.linear_acceleration_y": "m/s2",
    "imu.linear_acceleration_z": "m/s2",
}


class Bench:
    """A driver on a link in memory, a manual clock, and the board's side of the conversation."""

    def __init__(self, link: Link, sent: list[Frame], watchdog_s: float = 0.05, *, imu: bool = False) -> None:
        self.now_ns = 1_000 * MS
        settings = WheelBoardSettings(watchdog_s=watchdog_s, imu=imu, protocol=1)
        self.driver = WheelBoard(link, settings, loop_period_s=0.01, now_ns=lambda: self.now_ns)
        self._sent = sent
        self._counters = dict.fromkeys(FrameId, 0)

    def frame(self, frame_id: FrameId, payload: Payload) -> Frame:
        """The board's next frame, arriving now."""
        counter = self._counters[frame_id]
        self._counters[frame_id] += 1
        return Frame(frame_id, encode(frame_id, payload, counter), self.now_ns)

    def tell(self, frame_id: FrameId, payload: Payload) -> bool:
        """Let a frame of the board arrive now."""
        return self.driver.take_frame(self.frame(frame_id, payload))

    def tell_status(self, state: BoardState = BoardState.DISABLED, watchdog_s: float = 0.05) -> None:
        """Let the board's status arrive now."""
        assert self.tell(FrameId.BOARD_STATUS, replace(READY, state=state, watchdog_s=watchdog_s))

    def heard(self) -> list[tuple[int, Payload]]:
        """Everything the driver sent since the last call."""
        payloads = [(frame.arbitration_id, decode(frame.arbitration_id, frame.data)[0]) for frame in self._sent]
        self._sent.clear()
        return payloads

    def commanded(self, commands: Sequence[float] = (1.0, -2.0)) -> list[tuple[int, Payload]]:
        """What one cycle with these commands sends."""
        self._sent.clear()
        self.driver.command(commands)
        return self.heard()

    def is_enabled(self) -> bool:
        """Whether the driver has heard that the motors are on."""
        return self.driver.is_enabled

    def enable(self) -> None:
        """Enable the driver as far as the board is concerned."""
        self.tell_status()
        self.driver.enable()
        self.driver.command((0.0, 0.0))
        self.tell_status(BoardState.ENABLED)
        self.heard()


@pytest.fixture
def bench(link: Link, sent: list[Frame]) -> Bench:
    return Bench(link, sent)


@pytest.fixture
def moving(link: Link, sent: list[Frame]) -> Bench:
    """A bench whose board has an IMU."""
    return Bench(link, sent, imu=True)


def test_is_a_drive_with_named_and_limited_ports(bench: Bench) -> None:
    drive: Drive = bench.driver
    assert drive.name == "board"
    assert list(drive.signals.items()) == list({**WHEELS, **SUPPLY}.items())
    assert list(drive.commands.items()) == [("left.voltage", "V"), ("right.voltage", "V")]
    assert drive.limits == (30.0, 30.0)
    assert set(drive.listens_to) == {(0x120, False), (0x121, False), (0x130, False)}


def test_with_an_imu_its_axes_come_after_the_wheels_and_the_supply_last(moving: Bench) -> None:
    assert list(moving.driver.signals.items()) == list({**WHEELS, **IMU, **SUPPLY}.items())
    expected = {(frame_id, False) for frame_id in (0x120, 0x121, 0x122, 0x123, 0x130)}
    assert set(moving.driver.listens_to) == expected


def test_starting_sends_zero_disabled_and_then_the_watchdog(bench: Bench) -> None:
    bench.driver.start()
    assert bench.heard() == [ZERO, SETUP]


def test_before_anything_arrived_values_are_zero_infinitely_old_and_invalid(moving: Bench) -> None:
    readings = moving.driver.read()
    assert readings.values == (0.0,) * 11
    assert readings.ages == (math.inf,) * 11
    assert readings.valid == (False,) * 11
    assert moving.driver.faults() == ()


def test_each_wheel_has_its_own_values_ages_and_validity(bench: Bench) -> None:
    bench.tell(FrameId.LEFT_WHEEL, Wheel(9.0, 9.0))
    bench.tell(FrameId.LEFT_WHEEL, Wheel(1.5, -2.25))
    bench.now_ns += 51 * MS
    bench.tell(FrameId.RIGHT_WHEEL, Wheel(-3.5, 4.75))
    bench.now_ns += 2 * MS

    readings = bench.driver.read()

    assert readings.values[:4] == pytest.approx((1.5, -2.25, -3.5, 4.75))
    assert readings.ages[:4] == pytest.approx((0.053, 0.053, 0.002, 0.002))
    assert readings.valid == (False, False, True, True, False)


def test_gyro_and_acceleration_have_their_own_values_ages_and_validity(moving: Bench) -> None:
    moving.tell(FrameId.IMU_GYRO, AngularVelocity(0.125, -0.25, 0.5))
    moving.now_ns += 51 * MS
    moving.tell(FrameId.IMU_ACCELERATION, LinearAcceleration(-1.5, 2.5, 9.805))
    moving.now_ns += 1 * MS

    readings = moving.driver.read()

    assert readings.values[4:10] == pytest.approx((0.125, -0.25, 0.5, -1.5, 2.5, 9.805))
    assert readings.ages[4:10] == pytest.approx((0.052,) * 3 + (0.001,) * 3)
    assert readings.valid == (False,) * 7 + (True,) * 3 + (False,)


def test_what_is_measured_is_stale_after_three_periods_of_the_loop(moving: Bench) -> None:
    moving.tell(FrameId.LEFT_WHEEL, Wheel(0.0, 0.0))
    moving.tell(FrameId.RIGHT_WHEEL, Wheel(0.0, 0.0))
    moving.tell(FrameId.IMU_GYRO, AngularVelocity(0.0, 0.0, 0.0))
    moving.tell(FrameId.IMU_ACCELERATION, LinearAcceleration(0.0, 0.0, 0.0))
    moving.now_ns += 30 * MS
    assert moving.driver.read().valid[:10] == (True,) * 10
    moving.now_ns += 1
    assert moving.driver.read().valid[:10] == (False,) * 10


def test_in_a_fast_loop_what_is_measured_is_stale_after_three_periods_of_its_frame(link: Link) -> None:
    now_ns = 0
    driver = WheelBoard(link, WheelBoardSettings(imu=True, protocol=1), loop_period_s=0.001, now_ns=lambda: now_ns)
    for frame_id, payload in (
        (FrameId.LEFT_WHEEL, Wheel(0.0, 0.0)),
        (FrameId.RIGHT_WHEEL, Wheel(0.0, 0.0)),
        (FrameId.IMU_GYRO, AngularVelocity(0.0, 0.0, 0.0)),
        (FrameId.IMU_ACCELERATION, LinearAcceleration(0.0, 0.0, 0.0)),
    ):
        driver.take_frame(Frame(frame_id, encode(frame_id, payload, 0), 0))
    now_ns = 15 * MS
    assert driver.read().valid[:10] == (True,) * 10
    now_ns += 1
    assert driver.read().valid[:10] == (False,) * 10


def test_the_supply_is_the_statuss_and_valid_for_a_second(bench: Bench) -> None:
    assert bench.tell(FrameId.BOARD_STATUS, replace(READY, bus_voltage=24.5))
    bench.now_ns += 1_000 * MS
    readings = bench.driver.read()
    assert (readings.values[-1], readings.ages[-1], readings.valid[-1]) == pytest.approx((24.5, 1.0, True))
    assert bench.driver.arming_failures(), "the state that came with it is too old for more than that"
    bench.now_ns += 1
    assert bench.driver.read().valid[-1] is False


def test_supply_no_longer_sent_is_no_fault_of_its_own(bench: Bench) -> None:
    bench.enable()
    bench.now_ns += 2_000 * MS
    assert bench.driver.faults() == ("the wheel board's status is too old: 2000 ms",)


def test_a_value_is_as_old_as_its_frame_and_not_as_its_reading(bench: Bench) -> None:
    frame = bench.frame(FrameId.LEFT_WHEEL, Wheel(1.0, 1.0))
    bench.now_ns += 7 * MS
    assert bench.driver.take_frame(frame)
    assert bench.driver.read().ages[:2] == pytest.approx((0.007, 0.007))


def _flip(frame: Frame, bit: int = 2) -> Frame:
    return replace(frame, data=(int.from_bytes(frame.data, "little") ^ 1 << bit).to_bytes(8, "little"))


def test_a_damaged_frame_does_not_make_a_value_younger(bench: Bench) -> None:
    bench.tell(FrameId.LEFT_WHEEL, Wheel(1.0, 1.0))
    bench.now_ns += 10 * MS
    assert not bench.driver.take_frame(_flip(bench.frame(FrameId.LEFT_WHEEL, Wheel(2.0, 2.0))))

    readings = bench.driver.read()

    assert readings.values[0] == pytest.approx(1.0)
    assert readings.ages[0] == pytest.approx(0.010)
    assert bench.driver.health["refused.crc"] == "1"


TOLD: Sequence[tuple[FrameId, Payload]] = [
    (FrameId.LEFT_WHEEL, Wheel(5.0, 6.0)),
    (FrameId.RIGHT_WHEEL, Wheel(7.0, 8.0)),
    (FrameId.IMU_GYRO, AngularVelocity(1.0, 2.0, 3.0)),
    (FrameId.IMU_ACCELERATION, LinearAcceleration(4.0, 5.0, 6.0)),
    (FrameId.BOARD_STATUS, replace(READY, state=BoardState.ENABLED)),
]


@pytest.mark.parametrize(("frame_id", "payload"), TOLD)
def test_no_frame_with_one_flipped_bit_changes_anything(moving: Bench, frame_id: FrameId, payload: Payload) -> None:
    moving.driver.enable()
    before = moving.driver.read(), moving.is_enabled(), moving.driver.arming_failures()
    for bit in range(64):
        assert not moving.driver.take_frame(_flip(moving.frame(frame_id, payload), bit))
    assert (moving.driver.read(), moving.is_enabled(), moving.driver.arming_failures()) == before
    assert moving.driver.health["refused.crc"] == "64"
    assert moving.heard() == []


@pytest.mark.parametrize("imu", [False, True])
def test_no_identifier_and_length_that_is_not_listened_to_changes_anything(
    link: Link, sent: list[Frame], *, imu: bool
) -> None:
    bench = Bench(link, sent, imu=imu)
    bench.driver.enable()
    listened = {key.arbitration_id for key in bench.driver.listens_to}
    before = bench.driver.read(), bench.is_enabled(), bench.driver.arming_failures(), bench.driver.health
    for identifier in set(range(2048)) - listened:
        for length in range(9):
            assert not bench.driver.take_frame(Frame(identifier, bytes(length), bench.now_ns))
    assert (bench.driver.read(), bench.is_enabled(), bench.driver.arming_failures(), bench.driver.health) == before

    for identifier in listened:
        for length in range(8):
            assert not bench.driver.take_frame(Frame(identifier, bytes(length), bench.now_ns))
    assert (bench.driver.read(), bench.is_enabled(), bench.driver.arming_failures()) == before[:3]
    assert bench.driver.health["refused.length"] == str(8 * len(listened))
    assert sent == []


def test_without_an_imu_its_frames_are_somebody_elses(bench: Bench) -> None:
    assert not bench.tell(FrameId.IMU_GYRO, AngularVelocity(1.0, 1.0, 1.0))
    assert len(bench.driver.read().values) == 5
    assert not [name for name in bench.driver.health if name.startswith("refused.")]


def test_a_silent_board_refuses_arming_with_the_bus_to_look_at(bench: Bench) -> None:
    assert bench.driver.arming_failures() == [
        "the wheel board does not answer on memory; is it powered and on this bus?",
    ]


def test_a_board_that_fell_silent_refuses_arming_after_three_status_periods(bench: Bench) -> None:
    bench.tell_status()
    bench.now_ns += 60 * MS
    assert bench.driver.arming_failures() == []
    bench.now_ns += 1
    (reason,) = bench.driver.arming_failures()
    assert "does not answer" in reason


@pytest.mark.parametrize("watchdog_s", [0.0, 0.019, 0.051, 1.0])
def test_a_watchdog_off_or_out_of_range_refuses_arming(bench: Bench, watchdog_s: float) -> None:
    bench.tell_status(watchdog_s=watchdog_s)
    (reason,) = bench.driver.arming_failures()
    assert f"the board's watchdog is set to {watchdog_s:g} s, allowed is 0.02 to 0.05 s" in reason
    assert "does its firmware take BOARD_SETUP?" in reason


@pytest.mark.parametrize("watchdog_s", [0.02, 0.05])
def test_the_ends_of_the_watchdogs_range_are_allowed(bench: Bench, watchdog_s: float) -> None:
    bench.tell_status(watchdog_s=watchdog_s)
    assert bench.driver.arming_failures() == []


@pytest.mark.parametrize("state", OFF_BY_ITSELF)
def test_a_board_that_switched_itself_off_refuses_arming(bench: Bench, state: BoardState) -> None:
    bench.tell_status(state)
    assert bench.driver.arming_failures() == [f"the board reports {state.name}; if it stays, switch it off and on"]
    bench.tell_status()
    assert bench.driver.arming_failures() == []


def test_silent_imu_fails_arming(moving: Bench) -> None:
    moving.tell_status()
    (reason,) = moving.driver.arming_failures()
    assert reason.startswith("the board does not send IMU_GYRO and IMU_ACCELERATION; ")
    moving.tell(FrameId.IMU_GYRO, AngularVelocity(0.0, 0.0, 0.0))
    (reason,) = moving.driver.arming_failures()
    assert reason == "the board does not send IMU_ACCELERATION; has it an IMU? if not, set imu: false"
    moving.tell(FrameId.IMU_ACCELERATION, LinearAcceleration(0.0, 0.0, 9.805))
    assert moving.driver.arming_failures() == []


def test_all_arming_failures_are_reported_at_once(moving: Bench) -> None:
    moving.tell_status(BoardState.FAULT, watchdog_s=0.0)
    assert len(moving.driver.arming_failures()) == 3


def test_zero_is_sent_until_asked_to_enable(bench: Bench) -> None:
    assert bench.commanded() == [ZERO]
    bench.tell_status(BoardState.ENABLED)
    assert bench.commanded() == [ZERO], "a board that says it is on was not reported so by us"
    assert not bench.is_enabled()


def test_enabling_sends_zero_with_enable_until_the_board_confirms(bench: Bench) -> None:
    bench.tell_status()
    bench.driver.enable()
    assert bench.heard() == [], "the next cycle begins it"
    for _ in range(3):
        assert bench.commanded() == [ZERO_ENABLED]
        bench.tell_status()
        assert not bench.is_enabled()

    bench.tell_status(BoardState.ENABLED)

    assert bench.is_enabled()
    ((frame_id, command),) = bench.commanded((1.0, -2.0))
    assert frame_id == 0x110
    assert astuple(command) == pytest.approx((1.0, -2.0, True))


@pytest.mark.parametrize("state", OFF_BY_ITSELF)
def test_a_board_that_switched_itself_off_is_first_sent_a_command_that_does_not_enable(
    bench: Bench, state: BoardState
) -> None:
    bench.tell_status(state)
    bench.driver.enable()
    assert bench.commanded() == [ZERO]
    assert bench.driver.faults() == (), "it has its time to come out of that state"

    bench.tell_status(BoardState.DISABLED)
    assert bench.commanded() == [ZERO_ENABLED]
    bench.tell_status(BoardState.ENABLED)
    assert bench.is_enabled()


def test_a_board_that_does_not_enable_in_half_a_second_is_a_fault(bench: Bench) -> None:
    bench.tell_status()
    bench.driver.enable()
    bench.now_ns += 500 * MS
    bench.tell_status()
    assert bench.driver.faults() == ()
    bench.now_ns += 1
    assert bench.driver.faults() == ("the wheel board does not enable its motors: DISABLED",)
    bench.driver.disable()
    assert bench.driver.faults() == ()


def test_silence_while_enabling_is_a_fault_only_once_it_is_overdue(bench: Bench) -> None:
    bench.tell_status()
    bench.driver.enable()
    bench.now_ns += 500 * MS
    assert bench.driver.faults() == (), "a change of lines takes a moment, and until then zero is sent"
    bench.now_ns += 1
    assert len(bench.driver.faults()) == 1


def test_after_disabling_the_board_may_count_anew_as_it_does_on_another_line(bench: Bench) -> None:
    for _ in range(3):
        bench.tell_status()
    again = bench.frame(FrameId.BOARD_STATUS, READY)
    assert bench.driver.take_frame(again)
    assert not bench.driver.take_frame(again)
    bench.driver.disable()
    assert bench.driver.take_frame(again)
    assert not bench.driver.take_frame(again)
    assert bench.driver.health["refused.counter"] == "2"


def test_disabling_sends_zero_at_once_each_time_and_then_every_cycle(bench: Bench) -> None:
    bench.enable()
    bench.driver.disable()
    bench.driver.disable()
    assert bench.heard() == [ZERO, ZERO]
    assert not bench.is_enabled()
    assert bench.commanded() == [ZERO]


def test_enabling_again_waits_for_the_board_again(bench: Bench) -> None:
    bench.enable()
    bench.driver.disable()
    bench.tell_status()
    bench.now_ns += 10_000 * MS
    bench.driver.enable()
    bench.tell_status()
    assert not bench.is_enabled()
    assert bench.driver.faults() == (), "its time begins anew"
    assert bench.commanded() == [ZERO_ENABLED]
    bench.tell_status(BoardState.ENABLED)
    assert bench.is_enabled()
    assert bench.commanded() != [ZERO_ENABLED]


@pytest.mark.parametrize("state", [*OFF_BY_ITSELF, BoardState.DISABLED])
def test_a_board_that_switches_itself_off_or_restarts_while_enabled_is_a_fault_until_disabled(
    bench: Bench, state: BoardState
) -> None:
    bench.enable()
    assert bench.driver.faults() == ()
    bench.now_ns += 60 * MS + 1
    bench.tell_status(state)
    assert bench.driver.faults() == (f"the wheel board switched its motors off: {state.name}",)

    bench.driver.disable()
    assert bench.driver.faults() == ()


def test_a_status_of_before_the_command_confirms_no_longer_than_the_next_shows(bench: Bench) -> None:
    """Where another line was taken: what the board was asked on it before has come late, on a slow line."""
    bench.enable()
    bench.now_ns += 60 * MS
    bench.tell_status(BoardState.DISABLED)
    assert not bench.is_enabled()
    assert bench.driver.faults() == ()
    assert bench.commanded() == [ZERO_ENABLED]
    bench.tell_status(BoardState.ENABLED)
    assert bench.is_enabled()


@pytest.mark.parametrize("state", OFF_BY_ITSELF)
def test_a_board_that_switches_itself_off_just_after_it_was_enabled_is_a_fault(bench: Bench, state: BoardState) -> None:
    bench.enable()
    bench.tell_status(state)
    assert bench.driver.faults() == (f"the wheel board switched its motors off: {state.name}",)


def test_a_board_that_restarted_just_after_it_was_enabled_is_a_fault_half_a_second_later(bench: Bench) -> None:
    bench.enable()
    bench.tell_status(BoardState.DISABLED)
    bench.now_ns += 500 * MS
    bench.tell_status(BoardState.DISABLED)
    assert bench.driver.faults() == ()
    bench.now_ns += 1
    assert bench.driver.faults() == ("the wheel board does not enable its motors: DISABLED",)


def test_a_board_whose_status_falls_silent_while_enabled_is_a_fault(bench: Bench) -> None:
    bench.enable()
    bench.now_ns += 60 * MS
    assert bench.driver.faults() == ()
    bench.now_ns += 1 * MS
    assert bench.driver.faults() == ("the wheel board's status is too old: 61 ms",)


def test_a_board_that_was_switched_on_later_gets_its_watchdog_until_it_has_it(bench: Bench) -> None:
    for _ in range(2):
        bench.tell_status(watchdog_s=0.02)
        assert bench.heard() == [SETUP]
    bench.tell_status()
    assert bench.heard() == []


def test_the_watchdog_is_left_alone_while_enabling_and_enabled(bench: Bench) -> None:
    bench.driver.enable()
    bench.tell_status(watchdog_s=0.02)
    bench.tell_status(BoardState.ENABLED, watchdog_s=0.02)
    bench.tell_status(BoardState.ENABLED, watchdog_s=0.02)
    assert bench.heard() == []


@pytest.mark.parametrize("watchdog_s", [0.0203, 0.0225, 0.0333, 0.0475])
def test_a_watchdog_between_whole_milliseconds_is_sent_once_and_not_for_ever(
    link: Link, sent: list[Frame], watchdog_s: float
) -> None:
    bench = Bench(link, sent, watchdog_s)
    bench.driver.start()
    (_, taken) = bench.heard()[1]
    assert isinstance(taken, BoardSetup)

    bench.tell_status(watchdog_s=taken.watchdog_s)

    assert bench.heard() == []


def test_health_has_the_board_status_and_every_count_as_text(bench: Bench) -> None:
    status = BoardStatus(BoardState.FAULT, 24.5, 0.05, 77)
    frames = [bench.frame(FrameId.BOARD_STATUS, status) for _ in range(5)]
    taken = [bench.driver.take_frame(f) for f in (frames[0], frames[4], frames[4], replace(frames[4], data=b"short"))]

    assert taken == [True, True, False, False]
    assert bench.driver.health == {
        "lost": "3",
        "refused.counter": "1",
        "refused.length": "1",
        "state": "FAULT",
        "bus_voltage_v": "24.500",
        "watchdog_s": "0.050",
        "refused_frames": "77",
        "gaps": "0",
        "longest_gap_ms": "0.0",
    }


def _call(name: str) -> Callable[[WheelBoard], object]:
    return lambda driver: getattr(driver, name)()


@pytest.mark.parametrize("ask", [_call("read"), _call("arming_failures"), _call("faults")])
def test_asking_sends_nothing(bench: Bench, ask: Callable[[WheelBoard], object]) -> None:
    bench.enable()
    ask(bench.driver)
    assert bench.heard() == []


@pytest.mark.parametrize("state", list(BoardState))
def test_disable_feedback_is_every_state_but_enabled_after_the_command(bench: Bench, state: BoardState) -> None:
    bench.enable()
    assert not bench.driver.is_off
    bench.driver.disable()
    bench.tell_status()
    assert not bench.driver.is_off, "that had arrived by then"
    bench.now_ns += MS
    bench.tell_status(state)
    assert bench.driver.is_off is (state is not BoardState.ENABLED)


def test_it_is_off_only_while_its_status_is_fresh_whatever_else_it_sends(bench: Bench) -> None:
    said = [bench.driver.is_off]
    bench.tell_status()
    said.append(bench.driver.is_off)
    bench.driver.disable()
    said.append(bench.driver.is_off)  # it was off before it was told so again
    for _ in range(20):
        bench.now_ns += 10 * MS
        bench.tell(FrameId.LEFT_WHEEL, Wheel(0.0, 0.0))
    said.append(bench.driver.is_off)
    assert said == [False, True, True, False]


@pytest.mark.parametrize(("loop_period_s", "period_s"), [(0.02, 0.005), (0.005, 0.005), (0.001, 0.001)])
def test_a_board_may_send_as_quickly_as_the_loop(link: Link, loop_period_s: float, period_s: float) -> None:
    driver = WheelBoard(link, WheelBoardSettings(imu=True, protocol=1), loop_period_s)
    assert set(driver.periods_s.values()) == {period_s}
