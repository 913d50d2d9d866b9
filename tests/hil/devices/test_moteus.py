# SPDX-License-Identifier: MIT
"""Simulated moteus controllers against bytes written by hand from the firmware's sources and its protocol pages."""

import math
import random
import struct
from typing import Any

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.drives.moteus.settings import MoteusAxisSettings, MoteusSettings
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame
from segway_ecc.firmware_io.links.settings import CanSettings
from segway_ecc.hil.case_study.can import LockstepCanSeat
from segway_ecc.hil.case_study.seats import OfflineSeat
from segway_ecc.hil.devices.moteus import SIMULATED, SimulatedMoteus
from segway_ecc.node.sequence.manoeuvre import single_segment

SETTINGS = MoteusSettings(
    can=CanSettings(fd=True),
    axes={
        "left": MoteusAxisSettings(servo_id=1, max_torque=3.0),
        "right": MoteusAxisSettings(servo_id=9, max_torque=3.0, direction=-1, gear_ratio=2.0),
    },
)
AT_REST = {"left.angle": 0.0, "left.velocity": 0.0, "right.angle": 0.0, "right.velocity": 0.0}
FOLLOW, STOP = "01000a", "010000"
QUIET = "0d2300000000 0d2400000000"
"""The scales of kp and kd at zero."""


def floats(*values: float) -> str:
    return struct.pack(f"<{len(values)}f", *values).hex()


def torque(value: float, timeout_s: float = 0.04) -> str:
    return f"{FOLLOW} 0d20 {floats(math.nan)} 0d22 {floats(value)} {QUIET} 0d27 {floats(timeout_s)}"


class Bench:
    """Two controllers, and what they send."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []
        link: Any = self
        self.drives = SimulatedMoteus(link, SETTINGS)
        self.left, self.right = self.drives.controllers.values()
        self.outputs = dict(AT_REST)
        self.torques: list[float] = []

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def tick(self, text: str | None = None, *, servo_id: int = 1, times: int = 1) -> bytes:
        """A command without padding in the first of some milliseconds; the answer, without its padding."""
        frames = []
        if text is not None:
            frames = [Frame(0x8000 | servo_id, bytes.fromhex(text), is_extended=True, is_fd=True)]
        self.sent.clear()
        for _ in range(times):
            self.torques = list(self.drives.obey(frames, 0, self.outputs))
            frames = []
        return self.sent[0].data.rstrip(b"\x50") if self.sent else b""

    def follow(self, text: str, times: int = 40) -> None:
        """Repeat a command until it is followed."""
        for _ in range(times):
            self.tick(text)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_the_example_of_the_protocol_s_page_is_answered_in_its_form(bench: Bench) -> None:
    bench.outputs |= {"left.angle": 0.00804 * math.tau, "left.velocity": 0.0641 * math.tau}
    bench.follow(FOLLOW)
    answer = bench.tick("01000a07206000200150ff140400130d")
    assert answer.hex() == "2404000a00" + "5000" + "0001" + answer[9:11].hex() + "230d" + "481e00"


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        ("1100", "210000"),
        ("1500", "25000000"),
        ("1900", "290000000000"),
        ("1d00", "2d00" + floats(0.0)),
        ("1301", "2301" + "7f" + "ec" + "00"),
        ("140201", "240201" + struct.pack("<2h", 20_000, -8_000).hex()),
        ("1b01", "2b01" + struct.pack("<3i", 200_000, -200_000, 0).hex()),
        ("1f01", "2f01" + floats(2.000004, -2.000004, 0.0)),
        ("110d", "210d48"),
        ("150d", "250d6801"),
        ("160e", "260e2c010000"),
        ("1178", "317801"),
        ("50505011005050", "210000"),
    ],
)
def test_registers_are_read_as_the_four_types_with_their_scales(bench: Bench, question: str, answer: str) -> None:
    bench.outputs |= {"left.angle": 2.000004 * math.tau, "left.velocity": -2.000004 * math.tau}
    assert bench.tick(question).hex() == answer


def test_what_is_too_large_saturates_and_what_is_none_is_the_least(bench: Bench) -> None:
    bench.outputs |= {"left.angle": -50.0 * math.tau, "left.velocity": 100.0 * math.tau}
    assert bench.tick("1201").hex() == "2201" + "817f"
    bench.follow(torque(0.0))
    assert bench.tick("1120 1520 1920 1d20").hex() == "212080252000802920000000802d20" + floats(math.nan)


def test_writing_the_mode_sets_the_rest_of_a_command_back(bench: Bench) -> None:
    assert bench.tick(f"0d22{floats(0.5)} 1d22").hex() == "2d22" + floats(0.5)
    assert bench.tick(f"{FOLLOW} 1d22 1d23").hex() == "2d22" + floats(0.0) + "2d23" + floats(1.0)


@pytest.mark.parametrize(
    ("write", "question", "answer"),
    [
        ("0122 02", "1d22", 1.0),
        ("0522 3200", "1d22", 0.5),
        ("0922 f4010000", "1d22", 0.5),
        ("0123 7f", "1d23", 1.0),
        ("0520 0080", "1d20", math.nan),
        ("0527 2800", "1d27", 0.04),
    ],
)
def test_registers_are_written_as_the_four_types(bench: Bench, write: str, question: str, answer: float) -> None:
    (found,) = struct.unpack("<f", bench.tick(f"{FOLLOW} {write} {question}")[2:])
    assert found == pytest.approx(answer, nan_ok=True)


def test_writes_that_it_does_not_take_are_answered_with_their_error(bench: Bench) -> None:
    assert bench.tick("0101 05").hex() == "300102"
    assert bench.tick("0178 05").hex() == "307801"


def test_it_enables_within_some_ten_milliseconds_and_gives_the_torque(bench: Bench) -> None:
    modes = []
    for _ in range(15):
        bench.tick(torque(0.5))
        modes.append(bench.left.mode)
    assert modes == [2, *[3] * 9, *[10] * 5]
    assert bench.torques == [0.5, 0.0]


def test_torque_is_that_of_the_wheel_behind_its_gear(bench: Bench) -> None:
    for _ in range(15):
        bench.tick(torque(0.5), servo_id=9)
    assert bench.torques == [0.0, -1.0]


def test_what_it_answers_is_from_before_the_command_acts(bench: Bench) -> None:
    assert bench.tick(f"{torque(0.5)} 1100").hex() == "210000"
    assert bench.tick("1100").hex() == "210002"


def test_without_commands_it_times_out_and_only_a_stop_brings_it_back(bench: Bench) -> None:
    bench.follow(torque(0.5))
    bench.tick(times=39)
    assert bench.torques[0] == 0.5
    bench.tick("1100", times=2)
    assert (bench.left.mode, bench.torques[0]) == (11, 0.0)
    bench.follow(torque(0.5))
    assert (bench.left.mode, bench.torques[0]) == (11, 0.0)
    bench.tick(STOP)
    bench.follow(torque(0.5))
    assert (bench.left.mode, bench.torques[0]) == (10, 0.5)


@pytest.mark.parametrize(("mode", "torque_at_2_turns_s"), [(0.0, 0.0), (12.0, -0.1), (10.0, -0.1), (15.0, 0.0)])
def test_in_its_time_out_it_does_what_it_is_set_to(bench: Bench, mode: float, torque_at_2_turns_s: float) -> None:
    bench.left.configuration["servo.timeout_mode"] = mode
    bench.follow(torque(0.5))
    bench.outputs["left.velocity"] = 2.0 * math.tau
    bench.tick(times=50)
    assert bench.left.mode == 11
    assert bench.torques[0] == pytest.approx(torque_at_2_turns_s)


@pytest.mark.parametrize(("timeout_s", "lasts_ms"), [(0.0, 100), (0.02, 20), (math.nan, None)])
def test_a_command_without_a_time_out_has_that_of_the_configuration(
    bench: Bench, timeout_s: float, lasts_ms: int | None
) -> None:
    bench.follow(torque(0.5, timeout_s))
    bench.tick(times=(lasts_ms or 1_000) - 1)
    assert bench.left.mode == 10
    bench.tick(times=2)
    assert bench.left.mode == (10 if lasts_ms is None else 11)


def test_position_mode_goes_to_a_position_within_the_largest_torque(bench: Bench) -> None:
    bench.follow(f"{FOLLOW} 0d20{floats(0.25)}")
    assert bench.torques[0] == pytest.approx(1.0)
    bench.follow(f"{FOLLOW} 0d20{floats(0.25)} 0d25{floats(0.4)}")
    assert bench.torques[0] == pytest.approx(0.4)
    bench.follow(f"{FOLLOW} 0d20{floats(math.nan)} 0d25{floats(math.nan)}")
    assert bench.torques[0] == pytest.approx(1.0), "the position is held from before"


def test_zero_velocity_damps(bench: Bench) -> None:
    bench.outputs["left.velocity"] = 2.0 * math.tau
    bench.follow("01000c")
    assert (bench.left.mode, bench.torques[0]) == pytest.approx((12, -0.1))


@pytest.mark.parametrize(("volts", "fault"), [(47.0, 34), (3.9, 40)])
def test_a_supply_out_of_its_range_is_a_fault_that_a_stop_clears(bench: Bench, volts: float, fault: int) -> None:
    bench.follow(torque(0.5))
    bench.outputs["truth.supply_voltage"] = volts
    bench.follow(torque(0.5), 3)
    assert (bench.left.mode, bench.left.fault, bench.torques[0]) == (1, fault, 0.0)
    del bench.outputs["truth.supply_voltage"]
    bench.follow(torque(0.5))
    assert bench.left.mode == 1
    bench.tick(STOP)
    assert (bench.left.mode, bench.left.fault) == (0, 0)


@pytest.mark.parametrize("position", [0.02, -0.02])
def test_as_delivered_it_drives_within_a_hundredth_of_a_turn_only(bench: Bench, position: float) -> None:
    bench.left.configuration |= {"servopos.position_min": -0.01, "servopos.position_max": 0.01}
    bench.outputs["left.angle"] = position * math.tau
    bench.follow(torque(0.5))
    assert (bench.left.mode, bench.left.fault) == (1, 39)


@pytest.mark.parametrize("mode", [1, 2, 3, 4])
def test_modes_that_cannot_be_commanded_are_ignored(bench: Bench, mode: int) -> None:
    bench.follow(torque(0.5))
    bench.tick(f"0100{mode:02x}")
    assert (bench.left.mode, bench.torques[0]) == (10, 0.5)


def test_the_console_answers_conf_get_a_poll_later(bench: Bench) -> None:
    def ask(text: str) -> bytes:
        return bench.tick(bytes((0x40, 1, len(text))).hex() + text.encode().hex())

    assert ask("conf get servo.timeout_mode\n") == b"\x41\1\0"
    assert bench.tick("420105") == b"\x41\1\x050.000"
    assert bench.tick("420130") == b"\x41\1\x05000\r\n"
    assert bench.tick("420130") == b"\x41\1\0"
    ask("conf get servo.nothing\n")
    assert bench.tick("420130") == b"\x41\1\x0ferror reading\r\n"


def test_without_supply_they_are_silent_and_afterwards_as_just_switched_on(bench: Bench) -> None:
    bench.follow(torque(0.5))
    assert SIMULATED.press_stop is not None
    SIMULATED.press_stop(bench.drives, True)  # noqa: FBT003 - as the rig calls it
    assert bench.tick("1100") == b""
    assert bench.torques == [0.0, 0.0]
    SIMULATED.press_stop(bench.drives, False)  # noqa: FBT003
    assert bench.tick("1100").hex() == "210000"


def test_a_stop_acts_before_the_next_frame_can_be_there(bench: Bench) -> None:
    bench.follow(torque(0.5))
    frames = [Frame(0x8001, bytes.fromhex(f"{STOP}1100"), is_extended=True, is_fd=True)] * 2
    bench.sent.clear()
    assert bench.drives.obey(frames, 0, bench.outputs) == [0.0, 0.0]
    assert [frame.data[:3].hex() for frame in bench.sent] == ["21000a", "210000"]


@pytest.mark.parametrize(
    ("frame", "answers"),
    [
        (Frame(0x8001, b"\x11\0", is_extended=True, is_fd=True), [(0x100, False, True)]),
        (Frame(0x8009, b"\x11\0", is_extended=True, is_fd=True), [(0x900, True, True)]),
        (Frame(0xFE01, b"\x11\0", is_extended=True, is_fd=True), [(0x17E, False, True)]),
        (Frame(0x8001, b"\x11\0", is_extended=True), [(0x100, False, False)]),
        (Frame(0x8001, b"\x1f\x01", is_extended=True), [(0x100, False, True)]),
        (Frame(0x807F, b"\x11\0", is_extended=True, is_fd=True), [(0x100, False, True), (0x900, True, True)]),
        (Frame(0x0001, b"\x11\0", is_fd=True), []),
        (Frame(0x18001, b"\x11\0", is_extended=True, is_fd=True), []),
        (Frame(0x8003, b"\x11\0", is_extended=True, is_fd=True), []),
    ],
)
def test_who_is_asked_answers_as_it_was_asked(
    bench: Bench, frame: Frame, answers: list[tuple[int, bool, bool]]
) -> None:
    bench.drives.obey([frame, replace(frame, is_remote=True)], 0, bench.outputs)
    assert [(sent.arbitration_id, sent.is_extended, sent.is_fd) for sent in bench.sent] == answers
    assert all(len(sent.data) in FD_LENGTHS for sent in bench.sent)


def test_noise_moves_no_motor_on_its_own_account_and_raises_nothing(bench: Bench) -> None:
    chance = random.Random(1)  # noqa: S311 - noise, and the same every time
    for _ in range(3_000):
        data = chance.randbytes(chance.choice(FD_LENGTHS))
        bench.drives.obey([Frame(0x8001, data, is_extended=True, is_fd=True)], 0, bench.outputs)
        assert all(len(sent.data) in FD_LENGTHS for sent in bench.sent)
        bench.sent.clear()


@pytest.mark.parametrize(("linear", "angular", "duration"), [(2.0, 2.0, 10.0), (1.0, -0.5, 2.0)])
def test_the_cart_ends_where_the_model_does(tmp_path: Any, linear: float, angular: float, duration: float) -> None:
    manoeuvre = single_segment(linear, angular, duration)
    found = LockstepCanSeat(None, "cart-moteus").run("t", manoeuvre).trajectory
    offline = OfflineSeat(tmp_path).run("same", manoeuvre).trajectory
    assert found.x[-1] == pytest.approx(offline.x[-1], abs=0.05)
    assert found.y[-1] == pytest.approx(offline.y[-1], abs=0.05)
    assert abs(found.x[-1]) + abs(found.y[-1]) > 0.5 or duration > 5.0, "it did move"
