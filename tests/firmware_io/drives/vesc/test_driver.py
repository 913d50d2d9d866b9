# SPDX-License-Identifier: MIT
"""One wheel: 7 pole pairs, 0.1 N m/A, geared 2 to 1 and turned around; values worked out by hand."""

import math
import random
import struct

import pytest
from msgspec.structs import replace

from segway_ecc.firmware_io.devices import Drive, FrameKey
from segway_ecc.firmware_io.drives.enabling import ENABLE_WITHIN_NS
from segway_ecc.firmware_io.drives.vesc.condition import FAULT, FLAGS, ask
from segway_ecc.firmware_io.drives.vesc.driver import Vesc
from segway_ecc.firmware_io.drives.vesc.frames import Current, PacketId, Payload, Status, Status5, frame_of
from segway_ecc.firmware_io.drives.vesc.packets import Mode, frames_of
from segway_ecc.firmware_io.drives.vesc.settings import VescSettings, VescWheelSettings
from segway_ecc.firmware_io.integrity import Refusal
from segway_ecc.firmware_io.links.link import Frame, Link

MS = 1_000_000
RIGHT = VescWheelSettings(
    controller_id=9, pole_pairs=7, torque_constant=0.1, max_torque=3.0, gear_ratio=2.0, direction=-1
)
LEFT = VescWheelSettings(controller_id=8, pole_pairs=7, torque_constant=0.1, max_torque=3.0)
SETTINGS = VescSettings(axes={"left": LEFT, "right": RIGHT}, timeout_set_s=0.05)
SETUP = "in VESC Tool, App Settings > General, set Timeout to 50 ms and Timeout Brake Current to 0 A"


def current(amperes: float) -> Frame:
    return frame_of(PacketId.SET_CURRENT, 9, Current(amperes))


class Bench:
    """The driver of the right wheel, a manual clock, and the controller's side of the conversation."""

    def __init__(self, link: Link, sent: list[Frame]) -> None:
        self.now_ns = 1_000 * MS
        self.vesc = Vesc(link, "right", SETTINGS, 0.01, lambda: self.now_ns)
        self._sent = sent

    def tell(self, command: PacketId, payload: Payload, controller_id: int = 9) -> bool:
        frame = frame_of(command, controller_id, payload)
        return self.vesc.take_frame(replace(frame, received_ns=self.now_ns))

    def tell_status(self) -> None:
        assert self.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
        assert self.tell(PacketId.STATUS_5, Status5(0, 36.0))

    def answer(self, packet: str) -> bool:
        data = bytes.fromhex("0901" + packet)
        return self.vesc.take_frame(Frame(0x8FD, data, self.now_ns, is_extended=True))

    def is_enabled(self) -> bool:
        return self.vesc.is_enabled

    def commands(self) -> list[Frame]:
        """The commands sent since the last call, without questions."""
        found = [frame for frame in self._sent if frame.arbitration_id >> 8 != 8]
        self._sent.clear()
        return found

    def cycle(self, torque: float = 0.0) -> list[Frame]:
        """What one cycle sends, and 10 ms."""
        self._sent.clear()
        self.vesc.command((torque,))
        frames = list(self._sent)
        self.now_ns += 10 * MS
        return frames

    def measure(self, *, timed_out: bool | None = True) -> None:
        """Let the time-out be measured."""
        for _ in range(60):
            self.tell_status()
            if ask(253, 9, FLAGS) in self.cycle() and timed_out is not None:
                self.answer(f"32002000000{int(timed_out)}")
        self.tell_status()

    def enable(self) -> None:
        self.measure()
        assert self.vesc.arming_failures() == []
        self.vesc.enable()
        self.vesc.command((0.0,))
        self.now_ns += 10 * MS
        self.tell_status()
        assert self.vesc.is_enabled
        self._sent.clear()


@pytest.fixture
def bench(link: Link, sent: list[Frame]) -> Bench:
    return Bench(link, sent)


def test_is_a_drive_with_named_and_limited_ports(bench: Bench) -> None:
    drive: Drive = bench.vesc
    assert drive.name == "right"
    assert drive.signals == {"right.angle": "rad", "right.velocity": "rad/s", "right.torque": "N m"}
    assert drive.commands == {"right.torque": "N m"}
    assert drive.limits == (3.0,)
    assert set(drive.listens_to) == {FrameKey(i, is_extended=True) for i in (0x909, 0x1B09, 0x5FD, 0x6FD, 0x7FD, 0x8FD)}


def test_both_wheels_listen_to_frames_of_their_own(link: Link) -> None:
    left, right = (Vesc(link, name, SETTINGS, 0.01) for name in ("left", "right"))
    assert set(left.listens_to).isdisjoint(right.listens_to)


def test_starting_sends_zero(bench: Bench) -> None:
    bench.vesc.start()
    assert bench.commands() == [current(0.0)]


def test_before_anything_arrived_values_are_zero_infinitely_old_and_invalid(bench: Bench) -> None:
    readings = bench.vesc.read()
    assert readings.values == (0.0, 0.0, 0.0)
    assert readings.ages == (math.inf,) * 3
    assert readings.valid == (False,) * 3


def test_values_are_those_of_the_wheel(bench: Bench) -> None:
    bench.tell(PacketId.STATUS, Status(4200, -5.0, 0.1))  # 4200 / 7 = 600 turns a minute
    bench.tell(PacketId.STATUS_5, Status5(-84, 36.5))  # 84 / 42 = 2 turns
    readings = bench.vesc.read()
    assert readings.values == pytest.approx((2 * math.tau / 2, -10.0 * math.tau / 2, 5.0 * 0.1 * 2))
    assert readings.ages == (0.0,) * 3
    assert readings.valid == (True,) * 3


def test_the_angle_goes_on_where_the_tachometer_wraps(bench: Bench) -> None:
    bench.tell(PacketId.STATUS_5, Status5(2**31 - 1, 36.0))
    before = bench.vesc.read().values[0]
    bench.tell(PacketId.STATUS_5, Status5(-(2**31) + 41, 36.0))
    assert bench.vesc.read().values[0] - before == pytest.approx(-math.tau / 2, abs=1e-6)


def test_supply_of_the_left_controller_is_valid_for_a_second(link: Link) -> None:
    now_ns = 0
    left = Vesc(link, "left", SETTINGS, 0.01, lambda: now_ns)
    assert list(left.signals.items())[3:] == [("supply.voltage", "V")]
    assert (left.read().values[3], left.read().ages[3], left.read().valid[3]) == (0.0, math.inf, False)
    assert left.take_frame(frame_of(PacketId.STATUS_5, 8, Status5(42, 36.5)))
    now_ns = 1_000 * MS
    readings = left.read()
    assert (readings.values[3], readings.ages[3]) == pytest.approx((36.5, 1.0))
    assert readings.valid == (False, False, False, True)
    now_ns += 1
    assert left.read().valid == (False,) * 4
    assert left.faults() == ()


def test_each_kind_of_status_has_an_age_of_its_own(bench: Bench) -> None:
    bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    bench.now_ns += 50 * MS
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    assert bench.vesc.read().valid == (True, True, True)
    bench.now_ns += 1
    readings = bench.vesc.read()
    assert readings.valid == (False, True, True), "five periods of the loop"
    assert readings.ages == pytest.approx((0.05, 0.0, 0.0), abs=1e-6)


def test_a_damaged_frame_changes_nothing_and_is_counted(bench: Bench) -> None:
    bench.tell(PacketId.STATUS, Status(700, 1.0, 0.0))
    before = bench.vesc.read()
    assert not bench.vesc.take_frame(Frame(0x909, bytes(7), bench.now_ns, is_extended=True))
    assert not bench.vesc.take_frame(Frame(0x8FD, b"\x09", bench.now_ns, is_extended=True))
    assert not bench.vesc.take_frame(Frame(0x8FD, bytes.fromhex("0801320000800005"), bench.now_ns, is_extended=True))
    assert bench.vesc.read() == before
    health = bench.vesc.health
    assert (health["refused.length"], health["refused.unknown"], health["fault"]) == ("2", "1", "not reported")


@pytest.mark.parametrize("length", range(9))
def test_frames_that_are_not_listed_change_nothing(bench: Bench, length: int) -> None:
    bench.tell_status()
    before = bench.vesc.read(), bench.vesc.health, bench.vesc.arming_failures(), bench.vesc.faults()
    chance = random.Random(length)  # noqa: S311 - a test's chance, not a secret
    extended = [i for i in (chance.getrandbits(29) for _ in range(10_000)) if i not in (0x909, 0x1B09, 0x8FD)]
    data = b"\xff" * length
    frames = [Frame(i, data, bench.now_ns) for i in range(2_048)]
    frames += [Frame(i, data, bench.now_ns, is_extended=True) for i in extended]
    assert not any(bench.vesc.take_frame(frame) for frame in frames)
    assert (bench.vesc.read(), bench.vesc.health, bench.vesc.arming_failures(), bench.vesc.faults()) == before


def test_silent_controller_fails_arming_and_names_the_setting(bench: Bench) -> None:
    (reason,) = bench.vesc.arming_failures()
    assert reason == (
        "the right VESC (id 9) does not send STATUS and STATUS_5 on memory; is it powered and on this bus? "
        f"{SETUP}, and CAN status messages 1 and 5 to 200 Hz"
    )
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    (reason,) = bench.vesc.arming_failures()
    assert "does not send STATUS_5 on memory" in reason


def test_zero_is_sent_in_every_cycle_of_a_silent_controller(bench: Bench) -> None:
    assert all(current(0.0) in bench.cycle(1.0) for _ in range(50))


def test_the_time_out_is_measured_by_a_silence_before_arming(bench: Bench) -> None:
    bench.tell_status()
    assert current(0.0) in bench.cycle()
    assert bench.vesc.arming_failures() == [
        "the time-out of the right VESC (id 9) is being measured; try again in a moment",
        "the firmware and limits of the right VESC (id 9) are being read; try again in a moment",
    ]
    silent = 0
    while ask(253, 9, FLAGS) not in (frames := bench.cycle(1.0)):
        assert current(0.0) not in frames
        silent += 1
        bench.tell_status()
    assert silent == 7, "75 ms"
    bench.answer("320020000001")
    assert current(0.0) in bench.cycle()
    bench.tell_status()
    assert not any("time-out" in failure for failure in bench.vesc.arming_failures())
    assert bench.vesc.health["timeout"] == "measured, acts within 90 ms"
    assert bench.vesc.health["timeout_set_s"] == "0.05"


def test_a_time_out_that_does_not_act_refuses_arming(bench: Bench) -> None:
    bench.measure(timed_out=False)
    assert bench.vesc.arming_failures() == [
        f"the right VESC (id 9) did not time out within 130 ms without a command; {SETUP}"
    ]
    assert bench.vesc.health["timeout"] == "does not act"


def test_unreported_timeout_is_accepted_as_configured(bench: Bench) -> None:
    bench.measure(timed_out=None)
    assert bench.vesc.arming_failures() == []
    assert bench.vesc.health["timeout"].startswith("affirmed in the robot file, not measured")


def test_a_controller_that_was_away_is_measured_anew(bench: Bench) -> None:
    bench.measure()
    bench.now_ns += 31 * MS
    bench.cycle()
    bench.tell_status()
    assert "is being measured" in bench.vesc.arming_failures()[0]


def test_enabling_sends_zero_until_status_of_both_kinds_came_after_it(bench: Bench) -> None:
    bench.measure()
    bench.vesc.enable()
    bench.tell_status()
    assert not bench.is_enabled(), "nothing was sent yet"
    assert current(0.0) in bench.cycle(1.0)
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    assert not bench.is_enabled()
    assert current(0.0) in bench.cycle(1.0)
    bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    assert bench.is_enabled()
    assert bench.vesc.faults() == ()


def test_status_from_before_the_first_zero_confirms_nothing(bench: Bench) -> None:
    bench.measure()
    bench.vesc.enable()
    bench.vesc.command((0.0,))
    bench.tell_status()  # stamped no later than the zero
    assert not bench.is_enabled()


def test_it_is_the_first_zero_that_counts(bench: Bench) -> None:
    bench.measure()
    bench.vesc.enable()
    for _ in range(2):
        bench.cycle()
    bench.now_ns -= 15 * MS  # between the two
    bench.tell_status()
    assert bench.is_enabled()


def test_torque_becomes_motor_current_only_while_enabled(bench: Bench) -> None:
    bench.enable()
    bench.vesc.command((1.5,))
    assert bench.commands() == [current(-1.5 / 2 / 0.1)]
    bench.vesc.disable()
    assert bench.commands() == [current(0.0)]
    assert not bench.is_enabled()
    bench.vesc.command((1.5,))
    assert bench.commands() == [current(0.0)]


@pytest.mark.parametrize(("torque", "amperes"), [(3.1, -15.0), (-99.0, 15.0), (math.nan, 0.0), (math.inf, 0.0)])
def test_torque_is_limited_and_what_is_no_number_is_zero(bench: Bench, torque: float, amperes: float) -> None:
    bench.enable()
    bench.vesc.command((torque,))
    assert bench.commands() == [current(amperes)]
    assert bench.vesc.health.get("refused.range") == (None if math.isfinite(torque) else "1")


def test_enabling_again_waits_for_status_again(bench: Bench) -> None:
    bench.enable()
    bench.vesc.disable()
    bench.vesc.enable()
    assert current(0.0) in bench.cycle(1.0)
    assert not bench.is_enabled()
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    assert not bench.is_enabled()
    bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    assert bench.is_enabled()


def test_a_measurement_is_broken_off_by_enabling(bench: Bench) -> None:
    bench.tell_status()
    bench.cycle()
    bench.cycle()
    bench.vesc.enable()
    assert current(0.0) in bench.cycle()
    bench.vesc.disable()
    bench.tell_status()
    assert current(0.0) in bench.cycle(), "it begins with a zero again"
    assert current(0.0) not in bench.cycle()


def test_answers_that_come_while_it_is_commanded_measure_nothing(bench: Bench) -> None:
    bench.tell_status()
    bench.cycle()
    bench.vesc.enable()
    bench.now_ns += 100 * MS
    bench.answer("320020000001")
    assert bench.vesc.health["timeout"] == "not measured yet"


def test_a_measurement_is_broken_off_by_disabling_too(bench: Bench) -> None:
    bench.tell_status()
    bench.cycle()
    assert current(0.0) not in bench.cycle()
    bench.vesc.disable()
    assert current(0.0) in bench.cycle(), "it begins with a zero again"


def test_one_that_does_not_confirm_in_time_is_a_fault(bench: Bench) -> None:
    bench.measure()
    bench.vesc.enable()
    bench.cycle()
    assert bench.vesc.faults() == ()
    bench.now_ns += ENABLE_WITHIN_NS
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    (fault,) = bench.vesc.faults()
    assert "the right VESC (id 9) does not send STATUS_5 on memory" in fault


def test_one_that_is_not_commanded_in_time_is_a_fault_too(bench: Bench) -> None:
    bench.measure()
    bench.vesc.enable()
    bench.now_ns += ENABLE_WITHIN_NS + 1
    bench.tell_status()
    (fault,) = bench.vesc.faults()
    assert "does not send STATUS and STATUS_5" in fault


def test_one_that_falls_silent_while_enabled_is_a_fault_until_disabled(bench: Bench) -> None:
    bench.enable()
    bench.now_ns += 50 * MS
    bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    assert bench.vesc.faults() == ()
    bench.now_ns += 1 * MS
    assert bench.vesc.faults() == ("STATUS of the right VESC (id 9) is too old: 51 ms",)
    bench.vesc.disable()
    assert bench.vesc.faults() == ()


def test_faults_are_asked_for_ten_times_a_second(bench: Bench) -> None:
    asked = [ask(253, 9, FAULT) in bench.cycle() for _ in range(30)]
    assert asked == ([True] + [False] * 9) * 3


def test_a_reported_fault_refuses_arming_and_is_one_while_enabled(bench: Bench) -> None:
    bench.measure()
    assert bench.answer("320000800001")
    assert bench.vesc.arming_failures() == ["the right VESC (id 9) reports over-voltage (fault 1); remove its cause"]
    assert bench.vesc.faults() == ()
    assert bench.vesc.health["fault"] == "over-voltage (fault 1)"
    bench.answer("320000800000")
    assert bench.vesc.health["fault"] == "none"
    bench.enable()
    bench.answer("320000800005")
    assert bench.vesc.faults() == ("the right VESC (id 9) reports over-temperature of the power stage (fault 5)",)


def test_fault_code_expires_when_no_longer_reported(bench: Bench) -> None:
    bench.answer("320000800001")
    bench.now_ns += 300 * MS
    assert bench.vesc.health["fault"] == "over-voltage (fault 1)"
    bench.now_ns += 1
    assert bench.vesc.health["fault"] == "not reported"


def test_health_has_supply_and_current(bench: Bench) -> None:
    bench.tell(PacketId.STATUS, Status(0, -2.5, 0.0))
    bench.tell(PacketId.STATUS_5, Status5(0, 36.5))
    assert bench.vesc.health == {
        "phase": "off",
        "timeout_set_s": "0.05",
        "timeout": "not measured yet",
        "fault": "not reported",
        "unconfirmed_versions": "0",
        "firmware": "being asked",
        "bus_voltage_v": "36.5",
        "current_a": "-2.5",
        "gaps": "0",
        "longest_gap_ms": "0.0",
    }


def test_refused_frames_are_counted_by_cause(bench: Bench) -> None:
    bench.vesc.take_frame(Frame(0x909, b"", is_extended=True))
    assert bench.vesc.health[f"refused.{Refusal.LENGTH}"] == "1"


@pytest.mark.parametrize(
    ("amperes", "is_off"), [(0.0, True), (0.5, True), (-0.5, True), (0.6, False), (-0.6, False), (15.0, False)]
)
def test_disable_feedback_is_next_to_no_current_after_the_command(
    bench: Bench, amperes: float, *, is_off: bool
) -> None:
    bench.enable()
    bench.tell(PacketId.STATUS, Status(0, 9.0, 0.0))
    assert not bench.vesc.is_off
    bench.vesc.disable()
    bench.tell(PacketId.STATUS, Status(0, 0.0, 0.0))
    assert not bench.vesc.is_off, "that had arrived by then"
    bench.now_ns += MS
    bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    assert not bench.vesc.is_off
    bench.tell(PacketId.STATUS, Status(0, amperes, 0.0))
    assert bench.vesc.is_off is is_off


@pytest.mark.parametrize(
    ("max_torque", "off", "on"),  # the largest currents are 20, 3 and 0.5 A
    [(2.0, 0.5, 0.6), (0.3, 0.3, 0.4), (0.05, 0.1, 0.2)],
)
def test_what_is_next_to_no_current_is_less_where_little_can_be_asked_for(
    link: Link, max_torque: float, off: float, on: float
) -> None:
    left = VescWheelSettings(controller_id=8, pole_pairs=7, torque_constant=0.1, max_torque=max_torque)
    settings = VescSettings(axes={"left": left, "right": RIGHT}, timeout_set_s=0.05)
    vesc = Vesc(link, "left", settings, 0.01, lambda: 0)
    for amperes, is_off in ((off, True), (-off, True), (on, False), (-on, False)):
        assert vesc.take_frame(frame_of(PacketId.STATUS, 8, Status(0, amperes, 0.0)))
        assert vesc.is_off is is_off


def test_it_is_off_only_while_status_is_fresh_whatever_else_it_sends(bench: Bench) -> None:
    said = [bench.vesc.is_off]
    bench.tell_status()
    said.append(bench.vesc.is_off)
    bench.vesc.disable()
    said.append(bench.vesc.is_off)  # it was off before it was told so again
    for _ in range(20):
        bench.now_ns += 10 * MS
        bench.tell(PacketId.STATUS_5, Status5(0, 36.0))
    said.append(bench.vesc.is_off)
    assert said == [False, True, True, False]


@pytest.mark.parametrize(
    ("erpm", "amperes", "duty", "torque"),
    [
        (4200, 5.0, 0.1, -1.0),  # drives ahead
        (4200, -5.0, 0.1, 1.0),  # brakes while it turns ahead
        (-4200, 5.0, -0.1, 1.0),  # drives back
        (-4200, -5.0, -0.1, -1.0),  # brakes while it turns back
        (70, 0.3, 0.0, 0.06),  # the voltage is next to nothing: what current there is brakes
        (-70, -0.3, 0.0, -0.06),
        (0, 0.2, 0.0, 0.0),
    ],
)
def test_measured_torque_has_the_direction_of_the_torque(
    bench: Bench, erpm: float, amperes: float, duty: float, torque: float
) -> None:
    """STATUS has the current with the sign of the power; this wheel is turned around and geared 2 to 1."""
    bench.tell(PacketId.STATUS, Status(erpm, amperes, duty))
    assert bench.vesc.read().values[2] == pytest.approx(torque)


def ask_packet(packet: str) -> Frame:
    return Frame(0x809, bytes.fromhex("FD00" + packet), is_extended=True)


def answer_long(bench: Bench, packet: bytes, sender: int = 9) -> list[bool]:
    frames = frames_of(253, sender, Mode.PASS_ON, packet)
    return [bench.vesc.take_frame(replace(frame, received_ns=bench.now_ns)) for frame in frames]


VERSION = bytes.fromhex("000600") + b"60_MK5\0" + bytes(13)


def mcconf(*currents: float) -> bytes:
    return (b"\x0e" + struct.pack(">IBBBB4f", 776184161, 0, 0, 2, 0, *currents)).ljust(481, b"\1")


def test_firmware_and_limits_are_asked_before_arming_and_compared(bench: Bench) -> None:
    bench.tell_status()
    for _ in range(2):
        assert ask_packet("00") in bench.cycle()
        assert all(answer_long(bench, VERSION))
    assert ask_packet("0E") in bench.cycle()
    assert all(answer_long(bench, mcconf(14.0, -60.0, 40.0, -20.0)))
    for _ in range(20):
        bench.tell_status()
        assert not {ask_packet("00"), ask_packet("0E")} & set(bench.cycle())
    assert bench.vesc.health["firmware"] == "6.00 on 60_MK5; motor -60 to 14 A, input -20 to 40 A"

    bench.measure()
    (failure,) = bench.vesc.arming_failures()
    assert "the right VESC (id 9) allows 14 A of motor current" in failure
    assert "max_torque takes 15 A" in failure


def test_answers_of_another_controller_are_refused_and_no_question_goes_out_while_enabled(bench: Bench) -> None:
    bench.tell_status()
    bench.cycle()
    assert not answer_long(bench, VERSION, sender=8)[-1]
    bench.enable()
    assert not any(frame in (ask_packet("00"), ask_packet("0E")) for _ in range(20) for frame in bench.cycle())


def test_a_controller_that_was_away_is_asked_anew(bench: Bench) -> None:
    bench.tell_status()
    bench.cycle()
    answer_long(bench, VERSION)
    for _ in range(20):
        bench.cycle()
    assert bench.vesc.health["firmware"] == "being asked"
    bench.tell_status()
    assert ask_packet("00") in bench.cycle()
