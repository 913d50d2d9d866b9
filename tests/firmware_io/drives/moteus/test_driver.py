# SPDX-License-Identifier: MIT
"""One axis: geared 2 to 1 and turned around; values worked out by hand."""

import math
import random
import struct
from collections.abc import Mapping

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.devices import Drive, FrameKey
from segway_ecc.firmware_io.drives.enabling import ENABLE_WITHIN_NS
from segway_ecc.firmware_io.drives.moteus.driver import Moteus
from segway_ecc.firmware_io.drives.moteus.settings import MoteusAxisSettings, MoteusSettings
from segway_ecc.firmware_io.links.link import FD_LENGTHS, Frame, Link
from segway_ecc.firmware_io.links.settings import CanSettings

MS = 1_000_000
LEFT = MoteusAxisSettings(servo_id=1, max_torque=3.0)
RIGHT = MoteusAxisSettings(servo_id=9, max_torque=3.0, gear_ratio=2.0, direction=-1)
SETTINGS = MoteusSettings(can=CanSettings(fd=True), watchdog_s=0.04, axes={"left": LEFT, "right": RIGHT})
GOOD = {
    "servo.timeout_mode": "0",
    "servopos.position_min": "nan",
    "servopos.position_max": "nan",
    "servo.pid_position.ilimit": "0.000000",
    "servo.inertia_feedforward": "0.000000",
}
STOPPED, FAULT, CALIBRATING, POSITION, TIMEOUT = 0, 1, 3, 10, 11
TITLE = "the right moteus (id 9)"


class Bench:
    """The driver of the right axis, a manual clock, and the controller's side of the conversation."""

    def __init__(self, link: Link, sent: list[Frame]) -> None:
        self.now_ns = 1_000 * MS
        self.moteus = Moteus(link, "right", SETTINGS, 0.01, lambda: self.now_ns)
        self.answers, self.unheard = dict(GOOD), 0
        self._sent, self._text = sent, b""

    def reply(
        self,
        mode: int = STOPPED,
        motion: tuple[float, float, float] = (0.0, 0.0, 0.0),
        fault: int = 0,
        time_ms: int = 40,
    ) -> bool:
        """The controller's answer: turns, turns/s and N m of its motor."""
        data = struct.pack("<2sb2s3f2sf2s2b2shs", b"\x21\0", mode, b"\x2f\1", *motion, b"\x2d\x0d", 36.0,
                           b"\x22\x0e", 31, fault, b"\x25\x27", time_ms, b"\x50")  # fmt: skip
        return self.moteus.take_frame(Frame(0x900, data, self.now_ns, is_extended=True, is_fd=True))

    def cycle(self, torque: float = 0.0) -> list[Frame]:
        """What one cycle sends, and 10 ms; questions to the console are answered, unless they are `unheard`."""
        self._sent.clear()
        self.moteus.command((torque,))
        frames = list(self._sent)
        self.now_ns += 10 * MS
        for frame in frames:
            if frame.arbitration_id == 0xFE09:
                self._answer(frame.data)
        return [frame for frame in frames if frame.arbitration_id != 0xFE09]

    def _answer(self, data: bytes) -> None:
        if self.unheard:
            self.unheard -= 1
            return
        said = b""
        if data[0] == 0x42:
            said, self._text = self._text[:5], self._text[5:]
        else:
            name = data[3 : 3 + data[2]].decode().strip().removeprefix("conf get ")
            self._text += f"{self.answers.get(name, 'error reading')}\r\n".encode()
        text = (b"\x41\1" + bytes((len(said),)) + said).ljust(12, b"\x50")
        assert self.moteus.take_frame(Frame(0x97E, text, self.now_ns, is_extended=True, is_fd=True))

    def is_off(self) -> bool:
        return self.moteus.is_off

    def is_enabled(self) -> bool:
        return self.moteus.is_enabled

    def read_configuration(self) -> None:
        for _ in range(60):
            self.reply()
            self.cycle()
        self.reply()

    def enable(self) -> None:
        self.read_configuration()
        assert self.moteus.arming_failures() == []
        self.moteus.enable()
        self.cycle()
        self.reply(POSITION)
        assert self.moteus.is_enabled


@pytest.fixture
def bench(link: Link, sent: list[Frame]) -> Bench:
    return Bench(link, sent)


def torque_of(frames: list[Frame]) -> float:
    """The motor's torque in the one command of a cycle."""
    (frame,) = frames
    assert (frame.arbitration_id, frame.is_extended, frame.is_fd, len(frame.data)) == (0x8009, True, True, 48)
    head, position, velocity, torque, kp, kd, largest, timeout_head, timeout_s = struct.unpack_from(
        "<6s6f2sf", frame.data
    )
    assert (head, timeout_head) == (bytes.fromhex("01000a0c0620"), bytes.fromhex("0d27"))
    assert math.isnan(position)
    assert (velocity, kp, kd, largest) == (0.0, 0.0, 0.0, 1.5)
    assert timeout_s == pytest.approx(0.04)
    return float(torque)


def is_stop(frames: list[Frame]) -> bool:
    return [frame.data[:3] for frame in frames] == [bytes.fromhex("010000")]


def test_what_it_measures_and_takes(bench: Bench, link: Link) -> None:
    left = Moteus(link, "left", SETTINGS, 0.01, lambda: 0)
    drive: Drive = bench.moteus
    assert dict(drive.signals) == {"right.angle": "rad", "right.velocity": "rad/s", "right.torque": "N m"}
    assert list(left.signals) == ["left.angle", "left.velocity", "left.torque", "supply.voltage"]
    assert (dict(drive.commands), tuple(drive.limits)) == ({"right.torque": "N m"}, (3.0,))
    assert list(drive.listens_to) == [FrameKey(0x900, is_extended=True), FrameKey(0x97E, is_extended=True)]
    assert list(left.listens_to) == [FrameKey(0x100), FrameKey(0x17E)]
    assert drive.periods_s == {FrameKey(0x900, is_extended=True): 0.01}


def test_commands_of_any_source_and_to_all_are_not_for_others_to_send(bench: Bench) -> None:
    ours = set(bench.moteus.commanded_by)
    assert {FrameKey(9), FrameKey(0x8009, is_extended=True), FrameKey(0xFF09, is_extended=True)} <= ours
    assert {FrameKey(0x7F), FrameKey(0x807F, is_extended=True)} <= ours
    assert not ours & {FrameKey(0x900, is_extended=True), FrameKey(0x8001, is_extended=True)}


def test_it_is_stopped_at_the_start_and_in_every_cycle_in_which_it_is_off(bench: Bench, sent: list[Frame]) -> None:
    bench.moteus.start()
    assert is_stop(sent)
    assert sent[0].arbitration_id == 0x8009
    for _ in range(3):
        bench.reply()
        assert is_stop(bench.cycle(2.0))


def test_values_are_those_of_the_wheel(bench: Bench) -> None:
    assert bench.reply(POSITION, (1.0, -2.0, 0.25))
    readings = bench.moteus.read()
    assert readings.values == pytest.approx((-math.pi, 2.0 * math.pi, -0.5))
    assert (readings.valid, readings.ages) == ((True,) * 3, (0.0,) * 3)


def test_the_first_controller_measures_the_supply(link: Link) -> None:
    left = Moteus(link, "left", SETTINGS, 0.01, lambda: 0)
    assert left.read().valid == (False,) * 4
    data = bytes.fromhex("21000a2f010000803f000000c00000003e2d0d00001042220e1f002527280050")
    assert left.take_frame(Frame(0x100, data, is_fd=True))
    assert left.read().values[3] == 36.0
    assert left.read().valid == (True,) * 4


def test_turns_are_counted_over_the_wrap_of_the_controllers_position(bench: Bench) -> None:
    for position in (32_760.0, 32_767.5, -32_767.5, -32_760.0):
        bench.reply(POSITION, (position, 0.0, 0.0))
    assert bench.moteus.read().values[0] == pytest.approx(-math.pi * 32_776.0)
    for position in (-32_767.5, 32_767.5, 32_760.0):
        bench.reply(POSITION, (position, 0.0, 0.0))
    assert bench.moteus.read().values[0] == pytest.approx(-math.pi * 32_760.0)


def test_silence_is_not_valid_and_refuses_arming(bench: Bench) -> None:
    assert bench.moteus.read().valid == (False,) * 3
    (failure,) = bench.moteus.arming_failures()
    assert failure.startswith(f"{TITLE} does not answer on memory; is it powered and on this bus")
    bench.enable()
    bench.now_ns += 31 * MS
    assert bench.moteus.read().valid == (False,) * 3
    assert bench.moteus.faults()[0].startswith(f"{TITLE} does not answer")


def test_the_configuration_is_read_before_it_may_be_armed(bench: Bench) -> None:
    bench.reply()
    bench.cycle()
    assert bench.moteus.arming_failures() == [f"the configuration of {TITLE} is being read; try again in a moment"]
    bench.read_configuration()
    assert bench.moteus.arming_failures() == []
    assert {name: bench.moteus.health[name] for name in GOOD} == {name: f"{float(GOOD[name]):g}" for name in GOOD}
    assert is_stop(bench.cycle()), "and nothing is asked any more"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("servo.timeout_mode", "12"),
        ("servopos.position_min", "-0.010000"),
        ("servopos.position_max", "0.010000"),
        ("servo.pid_position.ilimit", "2.000000"),
        ("servo.inertia_feedforward", "0.001000"),
        ("servo.inertia_feedforward", "nan"),
        ("servo.timeout_mode", "error reading"),
    ],
)
def test_a_parameter_that_is_not_as_it_must_be_refuses_arming_with_the_remedy(
    bench: Bench, name: str, value: str
) -> None:
    bench.answers[name] = value
    bench.read_configuration()
    (failure,) = bench.moteus.arming_failures()
    assert failure.startswith(f"{name} of {TITLE} is ")
    shown = value if value == "error reading" else f"{float(value):g}"
    assert failure.partition(" is ")[2].startswith(f"{shown}, not ")
    assert failure.endswith(f"conf set {name} {float(GOOD[name]):g}, then conf write")


@pytest.mark.parametrize("unheard", [1, 2, 25])
def test_answers_that_are_lost_are_asked_for_again(bench: Bench, unheard: int) -> None:
    for _ in range(6):
        bench.reply()
        bench.cycle()
    bench.unheard = unheard
    bench.read_configuration()
    bench.read_configuration()
    assert bench.moteus.arming_failures() == []


def test_a_whole_answer_that_is_lost_is_asked_for_again(bench: Bench) -> None:
    bench.reply()
    bench.cycle()
    bench.cycle()
    bench._text = b""
    bench.read_configuration()
    assert bench.moteus.arming_failures() == []


def test_what_the_console_still_had_for_somebody_else_is_left_out(bench: Bench) -> None:
    bench._text = b"12\r\n12\r\n"
    bench.read_configuration()
    assert bench.moteus.arming_failures() == []


def test_a_controller_that_was_silent_is_read_anew(bench: Bench) -> None:
    bench.read_configuration()
    bench.now_ns += 100 * MS
    bench.cycle()
    bench.answers["servo.timeout_mode"] = "12"
    bench.reply()
    assert "is being read" in bench.moteus.arming_failures()[0]
    bench.read_configuration()
    assert "servo.timeout_mode" in bench.moteus.arming_failures()[0]


def test_a_time_out_of_another_length_refuses_arming(bench: Bench) -> None:
    bench.read_configuration()
    bench.reply(time_ms=100)
    assert bench.moteus.arming_failures() == [f"{TITLE} has a time-out of 0.1 s, not of 0.04 s"]
    bench.reply(time_ms=39)
    assert bench.moteus.arming_failures() == []


def test_torque_goes_out_once_the_controller_is_in_position_mode(bench: Bench) -> None:
    bench.read_configuration()
    bench.moteus.enable()
    for mode in (STOPPED, 2, CALIBRATING, 4):
        assert torque_of(bench.cycle(2.0)) == 0.0
        bench.reply(mode)
        assert not bench.is_enabled()
        assert bench.moteus.faults() == ()
    bench.reply(POSITION)
    assert bench.is_enabled()
    assert torque_of(bench.cycle(2.0)) == -1.0


@pytest.mark.parametrize(("torque", "motor"), [(9.0, -1.5), (-9.0, 1.5), (math.nan, 0.0), (math.inf, 0.0)])
def test_torque_stays_within_its_limit_and_is_a_number(bench: Bench, torque: float, motor: float) -> None:
    bench.enable()
    assert torque_of(bench.cycle(torque)) == motor
    assert bench.moteus.health.get("refused.range", "0") == str(int(not math.isfinite(torque)))


def test_a_stop_is_sent_twice_and_the_second_one_asks_beside_the_cycle(bench: Bench, sent: list[Frame]) -> None:
    bench.enable()
    sent.clear()
    bench.moteus.disable()
    assert is_stop(sent[:1])
    assert is_stop(sent[1:])
    assert [(frame.arbitration_id, frame.is_extended) for frame in sent] == [(0x7E09, True), (0xFE09, True)]
    assert not bench.is_off()
    assert is_stop(bench.cycle(1.0))
    bench.reply(POSITION)
    assert not bench.is_off()
    bench.reply(STOPPED)
    assert bench.is_off()
    bench.now_ns += 31 * MS
    assert not bench.is_off(), "an old report"


def test_what_was_reported_before_the_stop_does_not_count(bench: Bench) -> None:
    bench.reply(STOPPED)
    assert bench.is_off()
    bench.enable()
    bench.moteus.disable()
    bench.reply(TIMEOUT)
    assert not bench.is_off(), "it came as the stop was sent"


@pytest.mark.parametrize(
    ("mode", "fault", "text"),
    [
        (FAULT, 34, f"{TITLE} reports over-voltage (fault 34)"),
        (TIMEOUT, 0, f"{TITLE} does not follow: its mode is timeout"),
        (STOPPED, 0, f"{TITLE} does not follow: its mode is stopped"),
        (12, 0, f"{TITLE} does not follow: its mode is zero velocity"),
    ],
)
def test_a_controller_that_leaves_position_mode_is_a_fault(bench: Bench, mode: int, fault: int, text: str) -> None:
    bench.enable()
    assert bench.moteus.faults() == ()
    bench.reply(mode, fault=fault)
    assert bench.moteus.faults() == (text,)
    assert bench.moteus.health["mode"] in text or mode == FAULT
    bench.moteus.disable()
    assert bench.moteus.faults() == ()


def test_the_last_fault_stays_in_the_diagnostics(bench: Bench) -> None:
    assert bench.moteus.health["last_fault"] == "none"
    bench.reply(FAULT, fault=39)
    bench.reply(STOPPED)
    assert bench.moteus.health["last_fault"] == "outside servopos limits (fault 39)"


def test_a_controller_that_never_gets_there_is_a_fault(bench: Bench) -> None:
    bench.read_configuration()
    bench.moteus.enable()
    bench.now_ns += ENABLE_WITHIN_NS + 1
    bench.reply(CALIBRATING)
    assert bench.moteus.faults() == (f"{TITLE} does not follow: its mode is calibrating",)


def test_what_it_reports_of_itself(bench: Bench) -> None:
    bench.reply(POSITION)
    health: Mapping[str, str] = bench.moteus.health
    assert (health["phase"], health["mode"], health["bus_voltage_v"]) == ("off", "position", "36.0")
    assert (health["temperature_c"], health["gaps"]) == ("31.0", "0")


def test_noise_is_counted_and_changes_nothing(bench: Bench) -> None:
    bench.reply(POSITION, (1.0, 0.0, 0.0))
    before, chance = bench.moteus.read(), random.Random(1)  # noqa: S311 - noise, and the same every time
    for number in range(600):
        data, is_fd = chance.randbytes(chance.choice(FD_LENGTHS)), number % 3 > 0
        identifier = 0x900 if number % 2 else 0x97E
        assert not bench.moteus.take_frame(Frame(identifier, data, bench.now_ns, is_extended=True, is_fd=is_fd))
    assert bench.moteus.read() == before
    counts = [int(count) for name, count in bench.moteus.health.items() if name.startswith("refused.")]
    assert sum(counts) == 600


def test_the_frames_of_another_axis_are_not_taken_for_its_own(bench: Bench) -> None:
    assert bench.reply(POSITION)
    whole = Frame(0x900, bytes(32), is_fd=True, is_extended=True)
    assert not bench.moteus.take_frame(replace(whole, data=b""))


def test_the_answer_beside_the_cycle_is_an_answer_too(bench: Bench) -> None:
    bench.enable()
    bench.moteus.disable()
    bench.now_ns += MS
    data = bytes.fromhex("2100002f010000803f000000c00000003e2d0d00001042220e1f002527280050")
    assert bench.moteus.take_frame(Frame(0x97E, data, bench.now_ns, is_extended=True, is_fd=True))
    assert bench.is_off()
