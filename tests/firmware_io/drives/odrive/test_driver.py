# SPDX-License-Identifier: MIT
import itertools
import math
import struct
from collections.abc import Callable
from typing import Any

import pytest

from segway_ecc.firmware_io.devices import Drive
from segway_ecc.firmware_io.drives.odrive.driver import Odrive
from segway_ecc.firmware_io.drives.odrive.settings import OdriveSettings
from segway_ecc.firmware_io.links.link import Frame
from tests.recording_link import RecordingLink

Configure = Callable[..., OdriveSettings]
MS = 1_000_000
IDLE, CLOSED = 1, 8
EXPIRED = {"0.5": 0x800, "0.6": 0x01000000}

# Frames to node 0, from the table of messages.
ZERO = Frame(0x00E, bytes(8))
TO_IDLE = Frame(0x007, b"\1" + bytes(7))
TO_CLOSED = Frame(0x007, b"\x08" + bytes(7))
TORQUE_MODE = Frame(0x00B, bytes.fromhex("0100000001000000"))
CLEAR = {"0.5": Frame(0x018, b""), "0.6": Frame(0x018, b"\0")}
ASK_VERSION = Frame(0x000, b"", is_remote=True)
VERSION_0_6 = bytes.fromhex("0204043a00060a00")


class Bench:
    """A driver with a loop of 10 ms, a clock by hand, and the axis' side of the conversation."""

    def __init__(self, settings: OdriveSettings, name: str = "left") -> None:
        self.now_ns = 1_000 * MS
        self.link = RecordingLink()
        self.drive = Odrive(self.link, name, settings, 0.01, lambda: self.now_ns)
        self.node = settings.axes[name].node_id

    def hear(self, command: int, data: bytes) -> bool:
        return self.drive.take_frame(Frame(self.node * 32 + command, data, self.now_ns))

    def beat(self, state: int = IDLE, error: int = 0) -> None:
        self.hear(0x01, struct.pack("<IBxxx", error, state))

    def answer_version(self, data: bytes = VERSION_0_6, times: int = 2) -> None:
        """Answer so often; twice is believed."""
        for _ in range(times):
            assert self.hear(0x00, data)

    def estimate(self, position: float = 0.5, velocity: float = 0.0) -> None:
        self.hear(0x09, struct.pack("<ff", position, velocity))

    def sent(self) -> list[Frame]:
        frames = list(self.link.frames)
        self.link.frames.clear()
        return frames

    def cycle(self, torque: float = 0.0) -> list[Frame]:
        """One cycle, 10 ms long; what was sent in it."""
        self.sent()
        self.drive.command([torque])
        self.now_ns += 10 * MS
        return self.sent()

    def run(self, cycles: int, state: int = IDLE, error: int = 0, torque: float = 0.0) -> list[list[Frame]]:
        """Cycles with heartbeats every 20 ms and estimates, which begin 2 ms before a cycle's end."""
        found = []
        for index in range(cycles):
            found.append(self.cycle(torque))
            self.now_ns -= 2 * MS
            self.estimate()
            if index % 2:
                self.beat(state, error)
            self.now_ns += 2 * MS
        return found

    def expire(self, clean: int = 4, firmware: str = "0.5") -> None:
        """Tell the watchdog's error, forget it for some cycles when told to, and tell it again."""
        self.run(2, error=EXPIRED[firmware])
        self.run(clean)
        self.run(2, error=EXPIRED[firmware])

    def prove(self, firmware: str = "0.5") -> None:
        """Let the axis be found idle and its watchdog expire."""
        self.drive.start()
        self.expire(firmware=firmware)
        self.sent()

    def arm(self) -> None:
        self.prove()
        assert self.drive.arming_failures() == []
        self.drive.enable()
        self.run(6, CLOSED)
        assert self.drive.is_enabled
        self.sent()


@pytest.fixture
def bench(configure: Configure) -> Bench:
    return Bench(configure())


def test_is_a_drive_with_the_signals_of_its_wheel(configure: Configure) -> None:
    drive: Drive = Bench(configure(), "right").drive
    assert drive.name == "right"
    assert drive.signals == {"right.angle": "rad", "right.velocity": "rad/s", "right.torque": "N m"}
    assert drive.commands == {"right.torque": "N m"}
    assert drive.limits == (3.0,)
    assert {key.arbitration_id // 32 for key in drive.listens_to} == {1}


def test_starting_sends_zero_and_idle(bench: Bench) -> None:
    bench.drive.start()
    assert bench.sent() == [ZERO, TO_IDLE]


def test_silent_axis_gets_zero_every_cycle_and_idle_now_and_then(bench: Bench) -> None:
    bench.drive.start()
    cycles = [bench.cycle() for _ in range(20)]

    assert all(ZERO in frames for frames in cycles)
    with_idle = [index for index, frames in enumerate(cycles) if TO_IDLE in frames]
    assert 3 <= len(with_idle) <= 4
    assert all(frames in ([ZERO], [ZERO, TO_IDLE]) for frames in cycles)


def test_silence_towards_an_idle_axis_ends_when_its_heartbeats_do(bench: Bench) -> None:
    bench.drive.start()
    assert bench.run(6)[2:] == [[]] * 4
    assert [bench.cycle() for _ in range(5)] == [[]] * 5
    cycles = [bench.cycle() for _ in range(7)]
    assert all(ZERO in frames for frames in cycles[2:])
    assert any(TO_IDLE in frames for frames in cycles)


@pytest.mark.parametrize("state", [CLOSED, 3, 200])
def test_axis_not_idle_is_commanded_idle_and_never_left_in_silence(bench: Bench, state: int) -> None:
    bench.drive.start()
    cycles = bench.run(20, state)

    assert all(ZERO in frames for frames in cycles)
    assert sum(TO_IDLE in frames for frames in cycles) >= 3
    assert any("being set to idle" in failure for failure in bench.drive.arming_failures())


def test_idle_axis_receives_nothing_until_its_watchdog_has_expired_and_zero_from_then_on(bench: Bench) -> None:
    bench.drive.start()
    bench.run(2)
    assert bench.run(2) == [[], []]
    assert "watchdog is being tried" in bench.drive.arming_failures()[0]

    bench.run(2, error=0x800)
    assert "watchdog is being tried" in bench.drive.arming_failures()[0]
    assert bench.run(4) == [[ZERO, CLEAR["0.5"]], [], [], []]
    bench.run(2, error=0x800)
    assert bench.drive.arming_failures() == []
    # Told to forget its error at 60 ms; the first heartbeat with it after that came at 118 ms.
    assert bench.drive.health["watchdog_ms"] == "58.0"
    assert bench.run(5, error=0x800) == [[ZERO]] * 5


def test_the_error_of_before_is_cleared_once_and_then_awaited_in_silence(bench: Bench) -> None:
    bench.drive.start()
    bench.run(2, error=0x4800)
    assert bench.drive.arming_failures()

    assert bench.run(1, error=0x4800) == [[ZERO, CLEAR["0.5"]]]
    assert bench.drive.health["cleared"] == "WATCHDOG_TIMER_EXPIRED, ESTOP_REQUESTED"
    bench.run(1)  # a heartbeat on the way out of silence does not count, one without the error does
    assert bench.run(2) == [[], []]
    bench.run(2, error=0x800)
    assert bench.drive.arming_failures() == []


def test_an_error_that_stays_is_cleared_again_only_now_and_then(bench: Bench) -> None:
    bench.drive.start()
    cycles = bench.run(120, error=0x800)

    clears = [index for index, frames in enumerate(cycles) if CLEAR["0.5"] in frames]
    assert len(clears) == 4
    assert min(b - a for a, b in itertools.pairwise(clears)) >= 30
    assert "expires before a heartbeat can show it" in bench.drive.arming_failures()[0]


def test_disabled_watchdog_fails_arming_and_names_the_setting(bench: Bench) -> None:
    bench.drive.start()
    bench.run(40)

    (failure,) = bench.drive.arming_failures()
    assert "was not seen to expire" in failure
    assert "config.enable_watchdog = True" in failure
    assert "config.watchdog_timeout = 0.05" in failure
    assert bench.drive.health["watchdog_ms"] == "not seen"


@pytest.mark.parametrize(("beats", "allowed"), [(3, True), (5, False)])
def test_a_watchdog_may_take_its_time_one_heartbeat_and_one_cycle(bench: Bench, beats: int, *, allowed: bool) -> None:
    bench.drive.start()
    bench.expire(clean=2 * beats)
    failures = bench.drive.arming_failures()
    assert bool(failures) is not allowed
    if not allowed:
        assert "its watchdog took 118 ms, allowed is 80" in failures[0]


def test_a_watchdog_that_took_too_long_for_a_lost_heartbeat_is_tried_again(bench: Bench) -> None:
    bench.drive.start()
    bench.expire(clean=40)
    assert "its watchdog took" in bench.drive.arming_failures()[0]
    bench.run(4)
    bench.run(2, error=0x800)
    assert bench.drive.arming_failures() == []


def test_error_that_was_not_cleared_proves_nothing(bench: Bench) -> None:
    """Frames and heartbeats may be long on their way: what the axis was fed by may have left it any time before."""
    bench.drive.start()
    bench.run(4)
    bench.run(2, error=0x800)
    assert bench.drive.health["watchdog_ms"] == "not seen"


def test_heartbeats_with_the_error_that_were_on_their_way_do_not_count(bench: Bench) -> None:
    bench.drive.start()
    bench.run(2, error=0x800)
    assert CLEAR["0.5"] in bench.run(1)[0]
    bench.run(6, error=0x800)
    assert bench.drive.health["watchdog_ms"] == "not seen"


def test_a_frame_in_the_middle_of_an_attempt_ends_it(bench: Bench) -> None:
    bench.drive.start()
    bench.run(2, error=0x800)
    bench.run(4)
    bench.drive.start()
    bench.run(2)
    bench.run(2, error=0x800)
    assert bench.drive.health["watchdog_ms"] == "not seen"


def test_a_drive_that_may_have_been_restarted_has_to_prove_its_watchdog_again(bench: Bench) -> None:
    bench.prove()
    for _ in range(7):
        assert ZERO in bench.cycle()
    bench.beat()
    assert bench.drive.health["watchdog_ms"] == "not seen"
    assert any("heartbeats come" in failure for failure in bench.drive.arming_failures())
    assert bench.run(2)[1] == []
    bench.run(20)
    bench.expire()
    assert bench.drive.arming_failures() == []


@pytest.mark.parametrize(("firmware", "foreign"), [("0.5", 0x01000000), ("0.6", 0x800)])
def test_the_other_firmwares_bit_proves_nothing(configure: Configure, firmware: str, foreign: int) -> None:
    bench = Bench(configure(firmware=firmware))
    bench.drive.start()
    bench.run(2, error=EXPIRED[firmware])
    bench.run(4)
    bench.run(2, error=foreign)
    assert bench.drive.health["watchdog_ms"] == "not seen"
    bench.run(2, error=EXPIRED[firmware])
    assert bench.drive.health["watchdog_ms"] != "not seen"


def test_slow_heartbeats_fail_arming_and_name_the_setting(bench: Bench) -> None:
    bench.drive.start()
    for _ in range(3):
        bench.now_ns += 100 * MS
        bench.beat()
    failures = bench.drive.arming_failures()
    assert any("come 100 ms apart, 20 is expected; set can.heartbeat_rate_ms = 20" in text for text in failures)
    assert any("set can.encoder_rate_ms = 5" in text for text in failures)


def test_the_parameters_of_0_6_have_other_names(configure: Configure) -> None:
    bench = Bench(configure(firmware="0.6"))
    bench.beat()
    assert any("set can.encoder_msg_rate_ms = 5" in text for text in bench.drive.arming_failures())


def test_a_silent_axis_is_an_arming_failure(bench: Bench) -> None:
    (failure,) = bench.drive.arming_failures()
    assert failure.startswith("left ODrive axis (node 0) sends no heartbeat on recorded")


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
def test_enabling_takes_its_steps_in_order_then_zero_until_a_heartbeat_confirms(
    configure: Configure, firmware: str
) -> None:
    bench = Bench(configure(firmware=firmware))
    bench.prove(firmware)
    bench.drive.enable()

    steps = [TORQUE_MODE, ZERO, CLEAR[firmware], TO_CLOSED]
    cycles = bench.run(12, IDLE, torque=2.0)
    assert cycles[0] == cycles[6] == steps
    assert all(frames == [ZERO] for index, frames in enumerate(cycles) if index not in (0, 6))
    assert not bench.drive.is_enabled

    bench.run(2, CLOSED, torque=2.0)
    assert bench.drive.is_enabled


def test_a_heartbeat_from_before_the_steps_confirms_nothing(bench: Bench) -> None:
    bench.prove()
    bench.drive.enable()
    bench.beat(CLOSED)
    assert not bench.drive.is_enabled
    bench.cycle()
    bench.now_ns += 4 * MS
    bench.beat(CLOSED)  # 14 ms after the steps: a cycle and what a frame may wait
    assert not bench.drive.is_enabled
    bench.now_ns += 1 * MS
    bench.beat(CLOSED, error=0x1)
    assert not bench.drive.is_enabled
    bench.beat(CLOSED)
    assert bench.drive.is_enabled


def test_only_a_heartbeat_confirms_and_not_an_old_one_with_a_new_estimate(bench: Bench) -> None:
    bench.prove()
    bench.drive.enable()
    bench.beat(CLOSED)
    bench.cycle()
    bench.now_ns += 20 * MS
    bench.estimate()
    assert not bench.drive.is_enabled
    bench.beat(CLOSED)
    assert bench.drive.is_enabled


def test_an_axis_that_nobody_enabled_is_not_enabled_by_its_heartbeat(bench: Bench) -> None:
    bench.prove()
    bench.run(4, CLOSED)
    assert not bench.drive.is_enabled


def test_torque_goes_out_once_enabled_limited_and_as_the_motors(configure: Configure) -> None:
    bench = Bench(configure(), "right")
    bench.arm()

    def sent(torque: float) -> float:
        (frame,) = bench.cycle(torque)
        assert frame.arbitration_id == 0x02E
        assert len(frame.data) == 8
        value: float = struct.unpack("<ff", frame.data)[0]
        return value

    # Reversed, and half of it behind a gear of two.
    assert sent(1.0) == -0.5
    assert sent(-2.5) == 1.25
    assert sent(30.0) == -1.5
    assert sent(-math.inf) == sent(math.nan) == 0.0
    assert sent(-30.0) == 1.5


@pytest.mark.parametrize(("state", "error"), [(IDLE, 0), (CLOSED, 0x40)])
def test_no_torque_goes_to_an_axis_that_left_closed_loop(bench: Bench, state: int, error: int) -> None:
    bench.arm()
    assert bench.cycle(1.0) != [ZERO]
    bench.beat(state, error)
    assert [frame for frame in bench.cycle(1.0) if not frame.is_remote] == [ZERO]


def test_disabling_sends_zero_and_idle_every_time_and_insists_until_the_axis_is_idle(bench: Bench) -> None:
    bench.arm()
    for _ in range(2):
        bench.drive.disable()
        assert bench.sent() == [ZERO, TO_IDLE]
    assert not bench.drive.is_enabled

    cycles = bench.run(14, CLOSED, torque=2.0)
    assert all(frames in ([ZERO], [ZERO, TO_IDLE]) for frames in cycles)
    assert sum(TO_IDLE in frames for frames in cycles) == 2
    assert bench.run(14, IDLE)[-12:] == [[ZERO]] * 12


def test_re_enabling_begins_at_the_first_step(bench: Bench) -> None:
    bench.arm()
    bench.drive.disable()
    bench.drive.enable()
    assert not bench.drive.is_enabled
    bench.beat(CLOSED)
    assert not bench.drive.is_enabled
    assert bench.cycle() == [TORQUE_MODE, ZERO, CLEAR["0.5"], TO_CLOSED]


def test_all_is_well_while_enabled(bench: Bench) -> None:
    bench.arm()
    bench.run(50, CLOSED, torque=1.0)
    assert bench.drive.faults() == ()
    assert bench.drive.is_enabled


def test_errors_and_a_state_left_by_itself_are_faults_with_names(bench: Bench) -> None:
    bench.arm()
    bench.beat(IDLE, 0x900)
    (fault,) = bench.drive.faults()
    assert fault == (
        "the left ODrive axis switched its motor off: IDLE, errors: ENCODER_FAILED, WATCHDOG_TIMER_EXPIRED"
    )
    bench.beat(77)
    assert bench.drive.faults() == ("the left ODrive axis switched its motor off: state 77, errors: none",)


def test_silence_is_a_fault_three_periods_after_the_last_frame(bench: Bench) -> None:
    bench.arm()
    bench.beat(CLOSED)
    bench.estimate()
    bench.now_ns += 30 * MS
    assert bench.drive.faults() == ()
    bench.now_ns += 1
    assert bench.drive.faults() == ("the left ODrive axis's estimates too old: 30 ms",)


def test_one_message_that_is_missing_is_a_fault_after_five_periods(bench: Bench) -> None:
    bench.arm()
    start_ns = bench.now_ns
    bench.beat(CLOSED)
    bench.estimate()
    bench.now_ns = start_ns + 50 * MS
    bench.beat(CLOSED)
    assert bench.drive.faults() == ()
    bench.now_ns += 1
    assert bench.drive.faults() == ("the left ODrive axis's estimates too old: 50 ms",)
    for moment in (60, 90, 120, 150):
        bench.now_ns = start_ns + moment * MS
        bench.estimate()
    assert bench.drive.faults() == ()
    bench.now_ns += 1
    assert bench.drive.faults() == ("the left ODrive axis's heartbeat too old: 100 ms",)


def test_an_axis_that_does_not_enable_is_a_fault_after_half_a_second(bench: Bench) -> None:
    bench.prove()
    bench.drive.enable()
    bench.run(50, error=0x40)
    assert bench.drive.faults() == ()
    bench.now_ns += 1
    (fault,) = bench.drive.faults()
    assert fault == (
        "the left ODrive axis does not go to closed loop: IDLE, errors: MOTOR_FAILED; see dump_errors in odrivetool, "
        "and calibrate it where it is not: stop the node, wheels in the air, FULL_CALIBRATION_SEQUENCE, save"
    )
    bench.drive.disable()
    assert bench.drive.faults() == ()


def test_values_are_the_wheels_in_si(configure: Configure) -> None:
    bench = Bench(configure(), "right")
    assert bench.drive.read().ages == (math.inf,) * 3
    assert bench.drive.read().valid == (False,) * 3

    bench.estimate(-3.0, 0.5)
    bench.hear(0x14, struct.pack("<ff", 9.0, 4.0))
    bench.now_ns += 10 * MS
    readings = bench.drive.read()
    assert readings.values == pytest.approx((3.0 * math.pi, -0.5 * math.pi, -0.8))
    assert readings.ages == pytest.approx((0.01,) * 3)
    assert readings.valid == (True,) * 3
    bench.now_ns += 21 * MS
    assert bench.drive.read().valid == (False,) * 3


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
def test_supply_of_the_left_axis_is_valid_for_a_second(configure: Configure, firmware: str) -> None:
    bench = Bench(configure(firmware=firmware))
    assert list(bench.drive.signals.items())[3:] == [("supply.voltage", "V")]
    assert (bench.drive.read().ages[3], bench.drive.read().valid[3]) == (math.inf, False)
    assert bench.hear(0x17, struct.pack("<ff", 24.5, 1.0))
    bench.now_ns += 1_000 * MS
    readings = bench.drive.read()
    assert (readings.values[3], readings.ages[3]) == pytest.approx((24.5, 1.0))
    assert readings.valid == (False, False, False, True)
    bench.now_ns += 1
    assert bench.drive.read().valid[3] is False


def test_unreported_supply_is_no_fault_and_no_arming_failure(bench: Bench) -> None:
    bench.arm()
    bench.run(20, CLOSED)
    assert bench.drive.read().valid[3] is False
    assert bench.drive.faults() == ()
    assert bench.drive.arming_failures() == []


@pytest.mark.parametrize(("result", "stands"), [(14, True), (13, False), (0, False)])
def test_uncalibrated_axis_of_0_6_fails_arming(configure: Configure, result: int, *, stands: bool) -> None:
    bench = Bench(configure(firmware="0.6"))
    bench.prove("0.6")
    bench.hear(0x01, struct.pack("<IBBxx", 0, IDLE, result))
    expected = (
        "left ODrive axis (node 0) is not calibrated; calibrate it where it is not: stop the node, wheels in the air, "
        "FULL_CALIBRATION_SEQUENCE, save"
    )
    assert bench.drive.arming_failures() == [expected] * stands
    bench.hear(0x01, struct.pack("<IBBxx", 0, IDLE, 0))
    assert bench.drive.arming_failures() == []


def test_torque_comes_from_0_6_itself_and_is_missing_without_a_constant(configure: Configure) -> None:
    new = Bench(configure(firmware="0.6"))
    new.hear(0x14, struct.pack("<ff", 9.0, 4.0))
    assert new.drive.read().valid[2] is False
    new.hear(0x1C, struct.pack("<ff", 9.0, 0.75))
    assert new.drive.read().values[2] == 0.75

    wheel = {"node_id": 0, "max_torque": 1.0}
    without = Bench(configure(axes={"left": wheel}))
    without.hear(0x14, struct.pack("<ff", 9.0, 4.0))
    assert without.drive.read().valid[2] is False


def test_health_names_what_arrived(configure: Configure) -> None:
    bench = Bench(configure(firmware="0.6"))
    bench.beat(CLOSED, 0x0C000000)
    bench.estimate(1000.0, 0.0)
    bench.hear(0x17, struct.pack("<ff", 24.5, -1.25))
    bench.hear(0x15, struct.pack("<ff", 41.0, math.nan))
    bench.hear(0x09, bytes(7))
    health = bench.drive.health

    assert health["state"] == "CLOSED_LOOP_CONTROL"
    assert health["error"] == "SPINOUT_DETECTED, BRAKE_RESISTOR_DISARMED"
    assert health["firmware"] == "0.6"
    assert (health["bus.voltage_v"], health["bus.current_a"]) == ("24.5", "-1.25")
    assert health["temperature.transistors_c"] == "41"
    assert "temperature.motor_c" not in health
    assert health["refused.length"] == "1"
    # A 32-bit float has steps of 2^-14 turns from 512 turns on.
    assert float(health["angle_resolution_rad"]) == pytest.approx(2 * math.pi / 2**14, rel=0.05)


def test_a_firmware_that_has_to_be_found_is_asked_for_and_does_not_answer_if_it_is_0_5(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    cycles = bench.run(34)
    asked = [index for index, frames in enumerate(cycles) if ASK_VERSION in frames]
    assert asked == [0, 10, 20, 30]
    assert all(ZERO in frames for frames in cycles)
    assert "its firmware is being asked for" in bench.drive.arming_failures()[0]
    assert bench.drive.health["firmware"] == "unknown"

    bench.run(2)
    assert bench.drive.health["firmware"] == "0.5"
    assert bench.run(4)[1:] == [[], [], []]
    bench.expire()
    assert bench.drive.arming_failures() == []


def test_firmware_is_the_version_answered(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    bench.run(2)
    assert bench.hear(0x15, bytes(8)) is False, "what it means is not known yet"
    bench.answer_version()
    assert bench.drive.health["firmware"] == "0.6.10"
    bench.expire(firmware="0.6")
    assert bench.drive.arming_failures() == []
    assert not any(frame.is_remote for frames in bench.run(40) for frame in frames)


def test_a_late_answer_corrects_what_was_guessed_and_the_proof_begins_anew(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    bench.run(40)
    bench.expire()
    assert bench.drive.arming_failures() == []
    bench.answer_version()
    assert bench.drive.health["watchdog_ms"] == "not seen"
    assert bench.drive.arming_failures()


def test_an_axis_that_is_not_there_is_asked_until_it_is(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    frames = [frame for _ in range(100) for frame in bench.cycle()]
    assert frames.count(ASK_VERSION) == 10
    bench.run(20)
    assert bench.drive.health["firmware"] == "unknown", "its time to answer begins with its first heartbeat"


@pytest.mark.parametrize(("version", "is_old"), [("0204043a00050600", True), ("0204043a01000000", False)])
def test_the_version_decides_what_it_is(configure: Configure, version: str, *, is_old: bool) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    bench.beat()
    bench.answer_version(bytes.fromhex(version))
    bench.run(2)
    bench.expire()
    assert (bench.drive.arming_failures() == []) is is_old


def test_version_answer_of_a_drive_configured_as_0_5_fails_arming(bench: Bench) -> None:
    bench.prove()
    bench.answer_version()
    (failure,) = bench.drive.arming_failures()
    assert "answers that its firmware is 0.6.10; set firmware to '0.6' or 'auto'" in failure


@pytest.mark.parametrize("firmware", ["0.5", "auto"])
@pytest.mark.parametrize("when", ["before", "after"])
def test_one_frame_that_reads_as_a_version_does_not_keep_it_from_arming(
    configure: Configure, firmware: str, when: str
) -> None:
    bench = Bench(configure(firmware=firmware))
    bench.drive.start()
    bench.run(2)
    if when == "before":
        bench.answer_version(bytes.fromhex("51c07e9a80d3442f"), times=1)
    bench.run(40)
    bench.expire()
    if when == "after":
        bench.answer_version(VERSION_0_6, times=1)
    assert bench.drive.arming_failures() == []
    asked = [frame for frames in bench.run(40) for frame in frames if frame == ASK_VERSION]
    assert (len(asked) > 0) is (when == "after"), "the drive is asked whether that was so"
    assert bench.drive.arming_failures() == []
    assert bench.drive.health["firmware"] == "0.5"
    assert bench.drive.health["unconfirmed_versions"] == "1"


def test_a_drive_of_0_6_is_asked_again_at_once_where_a_frame_reads_as_another_version(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    bench.run(2)
    bench.answer_version(bytes.fromhex("51c07e9a00059934"), times=1)
    assert ASK_VERSION in bench.cycle()
    bench.answer_version(times=1)
    assert bench.drive.health["firmware"] == "unknown"
    assert ASK_VERSION in bench.cycle()
    bench.answer_version(times=1)
    assert bench.drive.health["firmware"] == "0.6.10"
    assert bench.drive.health["unconfirmed_versions"] == "1"


def test_no_remote_frame_is_sent_while_armed(configure: Configure) -> None:
    bench = Bench(configure(firmware="auto"))
    bench.drive.start()
    bench.run(40)
    bench.run(2, error=0x800)
    bench.drive.enable()
    frames = [frame for cycle in bench.run(100, CLOSED, torque=1.0) for frame in cycle]
    assert bench.drive.is_enabled
    assert not any(frame.is_remote for frame in frames)


def _state(bench: Bench) -> Any:
    health = {name: text for name, text in bench.drive.health.items() if not name.startswith("refused")}
    return bench.drive.read(), health, bench.drive.faults(), bench.drive.arming_failures(), bench.drive.is_enabled


@pytest.mark.parametrize("firmware", ["0.5", "0.6"])
def test_no_other_identifier_or_length_changes_anything(configure: Configure, firmware: str) -> None:
    listed = {0x00, 0x01, 0x03, 0x09, 0x14, 0x17, 0x1D} | ({0x04} if firmware == "0.5" else {0x15, 0x1C})
    bench = Bench(configure(firmware=firmware))
    bench.prove(firmware)
    before = _state(bench)
    for identifier in range(2048):
        for length in range(9):
            if identifier not in listed or length != 8:
                bench.drive.take_frame(Frame(identifier, b"\x40" * length, bench.now_ns))
    for identifier in listed:
        bench.drive.take_frame(Frame(identifier, b"\x40" * 8, bench.now_ns, is_extended=True))
    assert _state(bench) == before
    assert bench.sent() == []

    for identifier in listed:
        assert bench.drive.take_frame(Frame(identifier, b"\x40" * 8, bench.now_ns))
    assert _state(bench) != before


@pytest.mark.parametrize("state", range(14))
def test_disable_feedback_is_idle_and_no_other_state(bench: Bench, state: int) -> None:
    bench.arm()
    assert not bench.drive.is_off
    bench.drive.disable()
    bench.beat(IDLE)
    assert not bench.drive.is_off, "that had arrived by then"
    bench.now_ns += MS
    bench.estimate()
    assert not bench.drive.is_off
    bench.beat(state)
    assert bench.drive.is_off is (state == IDLE)


def test_it_is_off_only_while_heartbeats_are_fresh_whatever_else_it_sends(bench: Bench) -> None:
    said = [bench.drive.is_off]
    bench.beat()
    said.append(bench.drive.is_off)
    bench.drive.disable()
    said.append(bench.drive.is_off)  # it was off before it was told so again
    for _ in range(20):
        bench.now_ns += 10 * MS
        bench.estimate()
    said.append(bench.drive.is_off)
    assert said == [False, True, True, False]


def test_zeros_before_closed_loop_are_no_measurement_and_delay_enabling_to_the_first_estimate(bench: Bench) -> None:
    bench.prove()
    bench.estimate(0.0, 0.0)
    blind = bench.drive.read()
    assert (blind.valid[:2], blind.ages[:2]) == ((False, False), (math.inf, math.inf))
    assert blind.unseen == ("left.angle", "left.velocity")
    assert bench.drive.arming_failures() == []

    bench.drive.enable()
    for _ in range(3):
        bench.cycle()
        bench.estimate(0.0, 0.0)
    bench.beat(CLOSED)
    enabled = [bench.drive.is_enabled]
    bench.estimate(-1.75, 0.5)
    enabled.append(bench.drive.is_enabled)
    assert enabled == [False, True]
    seen = bench.drive.read()
    held = 0.5 * 2 * math.pi  # what it measured last
    assert seen.values[:2] == pytest.approx((held, math.pi))
    assert (seen.valid[:2], seen.unseen) == ((True, True), ())


def test_a_wheel_that_stands_at_zero_in_closed_loop_is_seen_there(bench: Bench) -> None:
    bench.prove()
    bench.estimate(0.0, 0.0)
    bench.drive.enable()
    bench.cycle()
    bench.now_ns += 20 * MS
    bench.beat(CLOSED)
    enabled = [bench.drive.is_enabled]
    bench.estimate(0.0, 0.0)
    enabled.append(bench.drive.is_enabled)
    assert enabled == [False, True]


def test_a_drive_that_may_have_restarted_is_blind_again(bench: Bench) -> None:
    bench.arm()
    bench.estimate(0.0, 0.0)
    assert bench.drive.read().valid[1]
    bench.drive.disable()
    bench.now_ns += 100 * MS
    bench.beat()
    bench.estimate(0.0, 0.0)
    assert not bench.drive.read().valid[1]


def asks(frames: list[Frame]) -> list[int]:
    """The commands that are asked for."""
    return [frame.arbitration_id for frame in frames if frame.is_remote]


def test_causes_of_an_error_are_asked_for_at_once_and_reported_with_the_remedy(bench: Bench) -> None:
    bench.arm()
    bench.beat(IDLE, 0x240)
    assert asks(bench.cycle(1.0)) == [0x03]
    assert bench.drive.faults()
    bench.drive.disable()
    bench.hear(0x03, struct.pack("<Q", 0x1000000))
    assert asks(bench.cycle()) == [0x1D]
    bench.hear(0x1D, struct.pack("<Ixxxx", 0x1))

    (event,) = bench.drive.read().events
    assert event.startswith("the left ODrive axis reports controller OVERSPEED (set controller.config.vel_limit above")
    assert bench.drive.read().events == ()
    causes = bench.drive.health["causes"]
    assert "motor SYSTEM_LEVEL (an error of the board, which CAN does not name; read odrv0.error over USB" in causes
    assert "set config.dc_max_negative_current" in causes
    assert not any(asks(bench.cycle()) for _ in range(30))


def test_cause_that_is_sent_unasked_is_named_in_the_fault(bench: Bench) -> None:
    bench.arm()
    bench.hear(0x1D, struct.pack("<Ixxxx", 0x1))
    bench.beat(IDLE, 0x200)
    (fault,) = bench.drive.faults()
    assert "errors: CONTROLLER_FAILED; causes: controller OVERSPEED (set controller.config.vel_limit" in fault


def test_part_that_does_not_answer_is_asked_three_times(bench: Bench) -> None:
    bench.arm()
    bench.beat(IDLE, 0x100)
    assert [asks(bench.cycle()) for _ in range(30)].count([0x04]) == 3


def test_no_cause_is_asked_for_in_the_silence_that_proves_the_watchdog(bench: Bench) -> None:
    bench.drive.start()
    bench.run(2, error=0x840)
    (frames,) = bench.run(1, error=0x840)
    assert frames[-1] == CLEAR["0.5"], "asked before the error is cleared"
    bench.run(1, error=0x840)
    assert not any(asks(frames) for frames in bench.run(4))


def test_causes_of_0_6_are_its_errors_and_what_disarmed_it(configure: Configure) -> None:
    bench = Bench(configure(firmware="0.6"))
    bench.beat(IDLE, 0x01000800)
    bench.cycle()
    bench.hear(0x03, struct.pack("<II", 0, 0x800))
    assert "DC_BUS_OVER_REGEN_CURRENT (set config.dc_max_negative_current" in bench.drive.health["causes"]
