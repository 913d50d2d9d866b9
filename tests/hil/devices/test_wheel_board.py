# SPDX-License-Identifier: MIT
from collections.abc import Iterable, Mapping

import pytest
from msgspec.structs import astuple

from segway_ecc.firmware_io.drives.wheel_board.frames import (
    AngularVelocity,
    BoardSetup,
    BoardState,
    BoardStatus,
    Endpoint,
    FrameId,
    LinearAcceleration,
    Payload,
    Wheel,
    WheelCommand,
    encode,
)
from segway_ecc.firmware_io.drives.wheel_board.serial_codec import BoardSerialCodec
from segway_ecc.firmware_io.drives.wheel_board.settings import WheelBoardSettings
from segway_ecc.firmware_io.links.link import Frame
from segway_ecc.hil.devices.device import Device
from segway_ecc.hil.devices.wheel_board import TICK_NS, SimulatedWheelBoard
from segway_ecc.hil.plants.cart import CartPlant
from segway_ecc.hil.rig.simulated_bus import SimulatedBus

ON = WheelCommand(3.0, -4.0, enable=True)
OFF = WheelCommand(3.0, -4.0, enable=False)
OUTPUTS: Mapping[str, float] = {
    "left.angle": 1.0,
    "left.velocity": 2.0,
    "right.angle": 3.0,
    "right.velocity": 4.0,
    "imu.angular_velocity_x": 0.1,
    "imu.angular_velocity_y": 0.2,
    "imu.angular_velocity_z": 0.3,
    "imu.linear_acceleration_x": 5.0,
    "imu.linear_acceleration_y": 6.0,
    "imu.linear_acceleration_z": 9.8,
}
RUNAWAY = {name: sign * 1e6 for name, sign in zip(OUTPUTS, (1, -1, -1, 1, 1, -1, 1, -1, 1, -1), strict=True)}
TELEMETRY = frozenset(FrameId) - {FrameId.WHEEL_COMMAND, FrameId.BOARD_SETUP}
WHEELS = [FrameId.LEFT_WHEEL, FrameId.RIGHT_WHEEL]
IMU = [FrameId.IMU_GYRO, FrameId.IMU_ACCELERATION]
STATUS = [FrameId.BOARD_STATUS]
VERSION_1 = WheelBoardSettings(protocol=1)
WITH_IMU = WheelBoardSettings(imu=True, protocol=1)


class Port:
    """One end of a serial line in memory."""

    def __init__(self) -> None:
        self.arrived = bytearray()
        self.written = bytearray()

    @property
    def in_waiting(self) -> int:
        return len(self.arrived)

    def read(self, size: int, /) -> bytes:
        data = bytes(self.arrived[:size])
        del self.arrived[:size]
        return data

    def write(self, data: bytes, /) -> int:
        self.written += data
        return len(data)

    def close(self) -> None:
        """Nothing to close."""


class SerialHost:
    """The host's end of the board's serial line."""

    def __init__(self, port: Port) -> None:
        self.line = BoardSerialCodec()
        self._port = port

    def send(self, frame: Frame) -> bool:
        self._port.arrived += self.line.encode(frame) or b""
        return True

    def ask(self) -> None:
        self._port.arrived += self.line.request()

    def receive(self) -> list[Frame]:
        data = bytes(self._port.written)
        self._port.written.clear()
        return self.line.decode(data, 0)


def _checked(endpoint: Endpoint, frames: Iterable[Frame]) -> list[tuple[FrameId, Payload]]:
    """What the frames carry, all of which pass."""
    payloads = [(FrameId(frame.arbitration_id), endpoint.check(frame)) for frame in frames]
    assert all(payload is not None for _, payload in payloads)
    return [(frame_id, payload) for frame_id, payload in payloads if payload is not None]


class Bench:
    """A board on a serial line and on a bus so fast that what is sent has arrived before the next tick."""

    def __init__(self, settings: WheelBoardSettings | None = None) -> None:
        self.now_ns = 0
        self.outputs = OUTPUTS
        bus = SimulatedBus(1_000_000_000, lambda: self.now_ns)
        port = Port()
        self.host_link, self.board_link = bus.attach("host"), bus.attach("board")
        self.serial_host = SerialHost(port)
        self.can, self.serial = Endpoint(self.host_link.send, TELEMETRY), Endpoint(self.serial_host.send, TELEMETRY)
        self.board = SimulatedWheelBoard(self.board_link, settings or VERSION_1, port)

    def tick(self, *commands: WheelCommand, times: int = 1) -> None:
        """Send commands over CAN, and let the board tick one period later."""
        for command in commands:
            self.can.send(FrameId.WHEEL_COMMAND, command)
        for _ in range(times):
            self.now_ns += TICK_NS
            self.board.obey(self.board_link.receive(), self.now_ns, self.outputs)
            self.board.send_telemetry(self.now_ns, self.outputs)

    def tick_serial(self, *commands: WheelCommand) -> None:
        """Send commands over the serial line, and let the board tick."""
        for command in commands:
            self.serial.send(FrameId.WHEEL_COMMAND, command)
        self.tick()

    def motors(self) -> tuple[BoardState, tuple[float, ...]]:
        """The board's state and what its motors are given."""
        return self.board.state, tuple(self.board.voltages)

    def state(self) -> BoardState:
        """The board's state."""
        return self.board.state

    def heard(self) -> list[tuple[FrameId, Payload]]:
        """All telemetry on the bus, since it was last asked for."""
        self.now_ns += 1_000
        return _checked(self.can, self.host_link.receive())

    def heard_serial(self) -> list[tuple[FrameId, Payload]]:
        """All telemetry on the serial line, since it was last asked for."""
        return _checked(self.serial, self.serial_host.receive())

    def status(self) -> BoardStatus:
        """The status that the board tells when asked over the serial line."""
        self.heard_serial()
        self.serial_host.ask()
        self.tick()
        (status,) = (payload for _, payload in self.heard_serial() if isinstance(payload, BoardStatus))
        return status


@pytest.fixture
def fresh() -> Bench:
    """A board that was just switched on."""
    return Bench()


@pytest.fixture
def bench(fresh: Bench) -> Bench:
    """A board that was told over CAN to be off."""
    fresh.tick(OFF)
    fresh.heard()
    return fresh


def test_is_a_device_that_fits_the_cart(fresh: Bench) -> None:
    device: Device = fresh.board
    assert list(device.inputs) == ["left.voltage", "right.voltage"] == [v.name for v in CartPlant.inputs]
    assert list(device.needs) == list(OUTPUTS)[:4]
    assert list(Bench(WITH_IMU).board.needs) == list(OUTPUTS)
    assert set(OUTPUTS) <= {v.name for v in CartPlant.outputs}


def test_wheels_are_sent_every_tick_and_the_status_every_twenty_milliseconds(fresh: Bench) -> None:
    fresh.tick(times=8)
    ids = [frame_id for frame_id, _ in fresh.heard()]
    assert ids == 2 * (WHEELS + STATUS + 3 * WHEELS)
    assert TICK_NS == 5_000_000


def test_the_status_is_also_sent_at_once_when_the_state_changes(bench: Bench) -> None:
    bench.tick(ON)
    bench.tick(ON)
    told = [(frame_id, getattr(payload, "state", None)) for frame_id, payload in bench.heard()]
    assert [state for frame_id, state in told if frame_id is FrameId.BOARD_STATUS] == [BoardState.ENABLED]


def test_an_imu_is_sent_after_the_wheels_where_the_settings_have_one() -> None:
    bench = Bench(WITH_IMU)
    bench.tick(times=5)
    heard = bench.heard()
    assert [frame_id for frame_id, _ in heard] == (WHEELS + IMU + STATUS) + 3 * (WHEELS + IMU) + (WHEELS + IMU + STATUS)
    told = dict(heard)
    assert astuple(told[FrameId.IMU_GYRO]) == pytest.approx((0.1, 0.2, 0.3))
    assert astuple(told[FrameId.IMU_ACCELERATION]) == pytest.approx((5.0, 6.0, 9.8))


def test_each_wheel_is_sent_with_its_own_values(fresh: Bench) -> None:
    fresh.tick()
    told = dict(fresh.heard())
    assert astuple(told[FrameId.LEFT_WHEEL]) == pytest.approx((1.0, 2.0))
    assert astuple(told[FrameId.RIGHT_WHEEL]) == pytest.approx((3.0, 4.0))


def test_values_beyond_the_range_of_the_frames_are_clamped() -> None:
    bench = Bench(WITH_IMU)
    bench.outputs = RUNAWAY
    bench.tick()
    assert bench.heard()[:4] == [
        (FrameId.LEFT_WHEEL, Wheel(200_000.0, -320.0)),
        (FrameId.RIGHT_WHEEL, Wheel(-200_000.0, 320.0)),
        (FrameId.IMU_GYRO, AngularVelocity(32.0, -32.0, 32.0)),
        (FrameId.IMU_ACCELERATION, LinearAcceleration(-160.0, 160.0, -160.0)),
    ]


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_one_axis_beyond_the_range_does_not_change_the_others(axis: int, sign: float) -> None:
    bench = Bench(WITH_IMU)
    names = [name for name in bench.outputs if name.startswith("imu.angular")]
    turning, told = [1.0, -2.0, 3.0], [1.0, -2.0, 3.0]
    turning[axis], told[axis] = sign * 40.0, sign * 32.0
    bench.outputs = {**bench.outputs, **dict(zip(names, turning, strict=True))}
    bench.tick()
    assert (FrameId.IMU_GYRO, AngularVelocity(*told)) in bench.heard()


def test_starts_with_its_motors_off_and_stays_so_without_a_command(fresh: Bench) -> None:
    fresh.tick(times=100)
    assert fresh.motors() == (BoardState.DISABLED, (0.0, 0.0))


def test_a_board_that_was_just_switched_on_enables_only_after_a_command_that_does_not(fresh: Bench) -> None:
    fresh.tick(ON, ON)
    fresh.tick_serial(ON)
    assert fresh.motors() == (BoardState.DISABLED, (0.0, 0.0))
    assert fresh.board.refused_frames == 3
    fresh.tick(OFF)
    fresh.tick(ON)
    assert fresh.motors() == (BoardState.ENABLED, (3.0, -4.0))


def test_motors_get_the_voltages_of_an_enabling_command(bench: Bench) -> None:
    bench.tick(ON)
    assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    bench.tick(WheelCommand(-1.0, 2.0, enable=True))
    assert tuple(bench.board.voltages) == (-1.0, 2.0)


def test_the_voltages_are_what_the_plant_is_given(bench: Bench) -> None:
    frame = Frame(FrameId.WHEEL_COMMAND, encode(FrameId.WHEEL_COMMAND, ON, 1))
    assert tuple(bench.board.obey([frame], bench.now_ns, OUTPUTS)) == (3.0, -4.0)


def test_a_command_that_does_not_enable_switches_off_whatever_its_voltages(bench: Bench) -> None:
    bench.tick(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))
    bench.tick(ON)
    bench.tick(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))


def test_of_commands_in_one_tick_the_last_one_counts(bench: Bench) -> None:
    bench.tick(ON, OFF)
    assert bench.state() is BoardState.DISABLED
    bench.tick(OFF, ON)
    assert bench.state() is BoardState.ENABLED


@pytest.mark.parametrize(("watchdog_s", "ticks"), [(None, 10), (0.05, 10), (0.02, 4), (0.1, 20)])
def test_the_watchdog_switches_off_once_the_time_has_passed(bench: Bench, watchdog_s: float | None, ticks: int) -> None:
    if watchdog_s is not None:
        bench.can.send(FrameId.BOARD_SETUP, BoardSetup(watchdog_s))
        bench.tick()
    bench.tick(ON)

    bench.tick(times=ticks)
    assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    bench.tick()
    assert bench.motors() == (BoardState.WATCHDOG, (0.0, 0.0))


def test_commands_in_time_keep_the_watchdog_quiet(bench: Bench) -> None:
    for _ in range(10):
        bench.tick(ON, times=10)
    assert bench.state() is BoardState.ENABLED


def test_only_an_enabled_board_runs_its_watchdog(bench: Bench) -> None:
    bench.tick(times=100)
    assert bench.state() is BoardState.DISABLED


def test_an_expired_watchdog_is_left_only_through_a_command_that_does_not_enable(bench: Bench) -> None:
    bench.tick(ON, times=12)
    bench.tick(ON)
    assert bench.motors() == (BoardState.WATCHDOG, (0.0, 0.0))
    assert bench.status().state is BoardState.WATCHDOG
    assert bench.board.refused_frames == 0
    bench.tick(OFF)
    assert bench.state() is BoardState.DISABLED
    bench.tick(ON)
    assert bench.state() is BoardState.ENABLED


def test_a_fault_lasts_as_long_as_its_cause_and_is_left_through_a_command_that_does_not_enable(bench: Bench) -> None:
    bench.tick(ON)
    bench.board.is_broken = True
    bench.tick(ON)
    assert bench.motors() == (BoardState.FAULT, (0.0, 0.0))
    bench.tick(OFF, ON)
    assert bench.motors() == (BoardState.FAULT, (0.0, 0.0))

    bench.tick(OFF)
    assert bench.motors() == (BoardState.FAULT, (0.0, 0.0))

    bench.board.is_broken = False
    bench.tick(ON)
    assert bench.motors() == (BoardState.FAULT, (0.0, 0.0))
    assert bench.status().state is BoardState.FAULT
    bench.tick(OFF)
    assert bench.state() is BoardState.DISABLED


def test_the_watchdog_is_set_while_not_enabled_only_and_reported_in_the_status(bench: Bench) -> None:
    assert bench.status().watchdog_s == pytest.approx(0.05)
    bench.can.send(FrameId.BOARD_SETUP, BoardSetup(0.03))
    bench.tick()
    assert astuple(bench.status()) == pytest.approx((BoardState.DISABLED, 36.0, 0.03, 0))

    bench.tick(ON)
    bench.can.send(FrameId.BOARD_SETUP, BoardSetup(1.0))
    bench.serial.send(FrameId.BOARD_SETUP, BoardSetup(1.0))
    bench.tick()
    assert astuple(bench.status()) == pytest.approx((BoardState.ENABLED, 36.0, 0.03, 0))

    bench.tick(OFF)
    bench.serial.send(FrameId.BOARD_SETUP, BoardSetup(0.04))
    bench.tick()
    assert bench.status().watchdog_s == pytest.approx(0.04)


def test_refused_frames_are_counted_reported_and_do_not_feed_the_watchdog(bench: Bench) -> None:
    bench.tick(ON)
    damaged = bytearray(encode(FrameId.WHEEL_COMMAND, ON, 2))
    damaged[0] ^= 1
    for _ in range(11):
        bench.host_link.send(Frame(FrameId.WHEEL_COMMAND, bytes(damaged)))
        bench.tick()
    bench.host_link.send(Frame(FrameId.BOARD_SETUP, b"short"))
    bench.tick()

    assert bench.state() is BoardState.WATCHDOG
    assert bench.board.refused_frames == bench.status().refused_frames == 12


@pytest.mark.parametrize("frame_id", [FrameId.WHEEL_COMMAND, FrameId.BOARD_SETUP])
def test_no_frame_with_one_flipped_bit_changes_anything(bench: Bench, frame_id: FrameId) -> None:
    payload = ON if frame_id is FrameId.WHEEL_COMMAND else BoardSetup(0.03)
    data = int.from_bytes(encode(frame_id, payload, 1), "big")
    for bit in range(64):
        frame = Frame(frame_id, (data ^ 1 << bit).to_bytes(8, "big"))
        bench.host_link.send(frame)
        bench.serial_host.send(frame)
    bench.tick()
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))
    assert bench.status().watchdog_s == pytest.approx(0.05)
    assert bench.board.refused_frames == 2 * 64


def test_no_identifier_and_length_but_its_own_changes_anything(bench: Bench) -> None:
    bench.tick(ON)
    for identifier in set(range(2048)) - {0x110, 0x111}:
        frames = [Frame(identifier, bytes(length)) for length in range(9)]
        for frame in frames:
            bench.serial_host.send(frame)
        bench.board.obey(frames, bench.now_ns, OUTPUTS)
    assert bench.board.refused_frames == 0
    for identifier in (0x110, 0x111):
        bench.board.obey([Frame(identifier, bytes(length)) for length in range(8)], bench.now_ns, OUTPUTS)
    assert bench.board.refused_frames == 16
    assert bench.heard_serial() == []
    assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    assert bench.status().watchdog_s == pytest.approx(0.05)


def test_a_request_on_the_serial_line_is_answered_in_the_same_tick_with_all_telemetry() -> None:
    bench = Bench(WITH_IMU)
    bench.tick()
    assert bench.heard_serial() == [], "it does not speak unasked"

    bench.outputs = {**OUTPUTS, "left.angle": 7.0}
    bench.serial_host.ask()
    bench.tick()

    heard = bench.heard_serial()
    assert [frame_id for frame_id, _ in heard] == WHEELS + IMU + STATUS
    assert astuple(dict(heard)[FrameId.LEFT_WHEEL]) == pytest.approx((7.0, 2.0))
    bench.tick()
    assert bench.heard_serial() == []


def test_without_an_imu_the_answer_has_none(bench: Bench) -> None:
    bench.serial_host.ask()
    bench.serial_host.ask()
    bench.tick()
    assert [frame_id for frame_id, _ in bench.heard_serial()] == WHEELS + STATUS, "one answer for both"


def test_the_answer_shows_what_the_commands_before_it_did(bench: Bench) -> None:
    bench.serial.send(FrameId.WHEEL_COMMAND, OFF)
    bench.serial.send(FrameId.WHEEL_COMMAND, ON)
    assert bench.status().state is BoardState.ENABLED


def test_counters_are_those_of_the_line(bench: Bench) -> None:
    for _ in range(7):
        bench.tick(OFF)
    bench.serial_host.ask()
    bench.tick_serial(OFF)
    assert bench.board.refused_frames == 0
    assert bench.can.lost == bench.serial.lost == 0
    assert len(bench.heard_serial()) == 3
    assert len(bench.heard()) > 14
    assert bench.can.refused == bench.serial.refused == {}


def test_a_board_without_a_serial_line_needs_none(fresh: Bench) -> None:
    board = SimulatedWheelBoard(fresh.board_link, VERSION_1)
    frames = [Frame(0x110, encode(FrameId.WHEEL_COMMAND, command, n)) for n, command in enumerate((OFF, ON))]
    assert tuple(board.obey([*frames, Frame(0x110, b"")], 0, OUTPUTS)) == (3.0, -4.0)
    assert board.refused_frames == 1


def test_the_serial_line_alone_drives_the_board(fresh: Bench) -> None:
    fresh.tick_serial(OFF)
    fresh.tick_serial(ON)
    assert fresh.motors() == (BoardState.ENABLED, (3.0, -4.0))
    fresh.tick(times=10)
    assert fresh.state() is BoardState.ENABLED
    fresh.tick()
    assert fresh.state() is BoardState.WATCHDOG


def test_a_command_in_pieces_is_taken_once_it_is_whole(fresh: Bench) -> None:
    fresh.tick_serial(OFF)
    port = Port()
    board = SimulatedWheelBoard(fresh.board_link, VERSION_1, port)
    host = SerialHost(port)
    Endpoint(host.send, TELEMETRY).send(FrameId.BOARD_SETUP, BoardSetup(0.03))
    host.ask()
    pieces, port.arrived = bytes(port.arrived), bytearray()
    for byte in pieces:
        assert port.written == b""
        port.arrived.append(byte)
        board.obey([], 0, OUTPUTS)
    status = [frame for frame in host.receive() if frame.arbitration_id == 0x130]
    assert status[0].data[:5] == bytes((0, *(36_000).to_bytes(2, "little"), 30, 0))


def test_garbage_on_the_serial_line_is_counted_and_what_follows_is_taken(fresh: Bench) -> None:
    fresh.serial_host._port.arrived += b"\x00\x05noise\x00"
    fresh.tick_serial(OFF, ON)
    assert fresh.state() is BoardState.ENABLED
    assert fresh.board.refused_frames == 1


def test_packets_lost_on_the_serial_line_are_not_refused(fresh: Bench) -> None:
    fresh.tick_serial(OFF)
    fresh.serial_host.line.request()
    fresh.tick_serial(ON)
    assert fresh.state() is BoardState.ENABLED
    assert fresh.board.refused_frames == 0


def test_enabling_commands_of_a_line_that_is_not_the_owner_are_counted_and_do_nothing(bench: Bench) -> None:
    bench.tick(ON)
    for _ in range(3):
        bench.tick_serial(WheelCommand(9.0, 9.0, enable=True))
        assert bench.motors() == (BoardState.ENABLED, (3.0, -4.0))
    assert bench.board.refused_frames == bench.status().refused_frames == 3


def test_enabling_commands_of_a_line_that_is_not_the_owner_do_not_feed_the_watchdog(bench: Bench) -> None:
    bench.tick(ON)
    for _ in range(10):
        bench.tick_serial(ON)
    assert bench.state() is BoardState.ENABLED
    bench.tick_serial(ON)
    assert bench.state() is BoardState.WATCHDOG
    bench.tick_serial(ON)
    assert bench.state() is BoardState.WATCHDOG


def test_either_line_can_stop_what_the_other_one_drives(bench: Bench) -> None:
    bench.tick(ON)
    bench.tick_serial(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))
    bench.tick_serial(ON)
    assert bench.state() is BoardState.ENABLED
    bench.tick(OFF)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0))


def test_a_command_that_does_not_enable_passes_the_ownership_to_its_line(bench: Bench) -> None:
    bench.tick(ON)
    bench.tick_serial(OFF)
    bench.tick(ON)
    assert bench.motors() == (BoardState.DISABLED, (0.0, 0.0)), "what came late out of the line that was left"
    assert bench.board.refused_frames == 1
    bench.tick_serial(WheelCommand(1.0, 2.0, enable=True))
    assert bench.motors() == (BoardState.ENABLED, (1.0, 2.0))
    bench.tick(ON)
    assert bench.motors() == (BoardState.ENABLED, (1.0, 2.0))


def test_an_expired_watchdog_is_left_over_the_other_line(bench: Bench) -> None:
    bench.tick(ON, times=12)
    bench.tick_serial(ON)
    assert bench.state() is BoardState.WATCHDOG
    bench.tick_serial(OFF, ON)
    assert bench.state() is BoardState.ENABLED


def test_never_do_two_lines_drive_it_whatever_their_order(fresh: Bench) -> None:
    """Every sequence of four commands over two lines: the voltages are those of the line that was told off last."""
    choices = [(line, command) for line in ("can", "serial") for command in (ON, OFF)]
    for number in range(len(choices) ** 4):
        sequence = [choices[number // len(choices) ** place % len(choices)] for place in range(4)]
        owner, driving = None, False
        fresh.board = SimulatedWheelBoard(fresh.board_link, VERSION_1, fresh.serial_host._port)
        for line, command in sequence:
            fresh.tick(command) if line == "can" else fresh.tick_serial(command)
            owner = owner if command.enable else line
            driving = (driving or owner == line) if command.enable else False
            assert fresh.state() is (BoardState.ENABLED if driving else BoardState.DISABLED), sequence
