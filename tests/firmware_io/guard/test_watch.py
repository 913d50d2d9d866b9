# SPDX-License-Identifier: MIT
"""What the guard decides, with drives made of single letters."""

from collections.abc import Sequence

import pytest

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.guard.watch import Cause, End, Watch
from segway_ecc.firmware_io.links.link import Frame

MS = 1_000_000
MOVE, ZERO, DISABLE, ON, OFF = Meaning
STOP = [Frame(0x51, b"left"), Frame(0x52, b"right")]


class Letters:
    """A frame's data is the drive and what is meant."""

    drives: Sequence[str] = ("left", "right")

    def __init__(self, *, reports: bool = True) -> None:
        self.reports = reports

    def read(self, frame: Frame) -> Observation | None:
        drive, _, meaning = frame.data.decode().partition(" ")
        return Observation(drive, Meaning(meaning)) if meaning else None

    def stop(self) -> Sequence[Frame]:
        return STOP


class Bench:
    """A watch, with a clock that is stepped each millisecond."""

    def __init__(self, *, reports: bool = True, start_ms: int = 1_000) -> None:
        self.now_ms = start_ms
        self.watch = Watch(Letters(reports=reports), start_ms * MS)
        self.sent: list[tuple[int, Sequence[Frame]]] = []

    def say(self, meaning: Meaning, drive: str = "both", at_ms: int | None = None) -> None:
        for name in ("left", "right") if drive == "both" else (drive,):
            at_ns = (self.now_ms if at_ms is None else at_ms) * MS
            self.watch.take_frame(Frame(1, f"{name} {meaning}".encode(), at_ns))

    def wait(self, ms: int) -> None:
        for _ in range(ms):
            self.now_ms += 1
            frames = self.watch.step(self.now_ms * MS)
            if frames:
                self.sent.append((self.now_ms, frames))

    def beat(self, *, is_on: bool = True) -> None:
        self.watch.beat(self.now_ms * MS, is_on=is_on)

    def drive(self, ms: int, meaning: Meaning = MOVE) -> None:
        """The node lives, and commands every 10 ms."""
        for _ in range(ms // 10):
            self.beat(is_on=meaning is MOVE)
            self.say(meaning)
            self.wait(10)

    @property
    def times(self) -> list[int]:
        return [ms for ms, _ in self.sent]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def ends(bench: Bench) -> list[End]:
    return [done.end for done in bench.watch.interventions if done.end is not None]


def test_nothing_is_sent_while_the_node_lives(bench: Bench) -> None:
    bench.drive(500)
    bench.say(ON)
    bench.drive(500)

    assert bench.sent == []
    assert (bench.watch.commands, bench.watch.heartbeats, bench.watch.strange) == (200, 100, 0)
    assert bench.watch.longest_gap_ns == 10 * MS


def test_a_gap_counts_only_where_a_drive_may_follow(bench: Bench) -> None:
    bench.drive(200, ZERO)
    assert bench.watch.longest_gap_ns == 0
    bench.say(ON, "right")
    bench.drive(100, ZERO)

    assert bench.watch.longest_gap_ns == 10 * MS


def test_nothing_is_sent_where_nothing_was_ever_received(bench: Bench) -> None:
    bench.wait(1_000)

    assert bench.sent == []


@pytest.mark.parametrize("last", [ZERO, DISABLE])
def test_commands_that_stop_after_a_zero_leave_nothing_to_stop(bench: Bench, last: Meaning) -> None:
    bench.drive(100)
    bench.say(last)
    bench.wait(500)
    bench.drive(50)

    assert bench.sent == []
    assert bench.watch.longest_gap_ns == 10 * MS


def test_commands_that_stop_are_followed_by_stop_frames_until_the_drives_are_off(bench: Bench) -> None:
    bench.drive(100)  # the last command was at 1090
    bench.wait(50)
    bench.say(OFF)
    bench.wait(200)

    assert bench.sent == [(1_121, STOP), (1_131, STOP), (1_141, STOP)]
    (done,) = bench.watch.interventions
    assert bench.watch.intervened == 1
    assert (done.cause, done.end, done.frames) == (Cause.SILENCE, End.OFF, 6)
    assert (done.last_alive_ns, done.first_ns, done.last_ns) == (1_090 * MS, 1_121 * MS, 1_141 * MS)


def test_a_report_that_a_command_to_move_has_followed_does_not_end_it(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(25)
    bench.say(OFF)
    bench.say(MOVE, "left")
    bench.wait(1)

    assert not ends(bench)
    assert bench.times == [1_121, 1_126]


def test_drive_that_reports_off_is_off(bench: Bench) -> None:
    bench.say(ON)
    bench.drive(20, ZERO)
    bench.say(OFF)
    bench.wait(100)

    assert bench.sent == []


def test_a_zero_right_after_a_stopped_node_s_command_makes_up_for_it(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(30)
    bench.say(OFF)
    bench.wait(100)
    bench.sent.clear()
    bench.say(MOVE)
    bench.say(ZERO)
    bench.wait(100)

    assert bench.sent == []


def test_a_report_of_both_drives_is_needed(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(25)
    bench.say(OFF, "left")
    bench.wait(20)
    assert len(bench.sent) == 3
    bench.say(OFF, "right")
    bench.wait(100)

    assert len(bench.sent) == 3


@pytest.mark.parametrize("were_on", [True, False])
def test_silent_drives_get_stop_frames_for_a_second(bench: Bench, *, were_on: bool) -> None:
    if were_on:
        bench.say(ON)
    bench.drive(100)
    bench.wait(3_000)

    assert bench.times == list(range(1_121, 2_121, 10))
    assert bench.watch.interventions[0].end is End.TIME
    assert bench.watch.intervened == 1


def test_drive_still_on_after_an_intervention_is_stopped_again(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(1_050)
    bench.say(ON, "right")
    bench.wait(1)

    assert bench.times[-1] == bench.now_ms
    assert bench.watch.intervened == 2


def test_a_drive_that_is_on_though_the_node_sent_zero_is_stopped(bench: Bench) -> None:
    bench.drive(100, ZERO)
    bench.say(ON, "left")
    bench.wait(100)

    assert bench.times[0] == 1_121


def test_a_zero_does_not_switch_a_drive_off(bench: Bench) -> None:
    bench.say(ON, "left")
    bench.drive(100, ZERO)
    bench.wait(100)

    assert bench.times[0] == 1_121


def test_disabled_drive_counts_as_off_until_it_reports_on(bench: Bench) -> None:
    bench.say(ON)
    bench.drive(100)
    bench.say(DISABLE)
    bench.wait(200)
    assert bench.sent == []
    bench.say(ON)
    bench.wait(1)

    assert bench.times == [bench.now_ms]


def test_a_drive_that_is_on_and_never_commanded_is_stopped_after_the_limit(bench: Bench) -> None:
    bench.say(ON, "left")
    bench.wait(31)

    assert bench.times == [1_031]
    assert bench.watch.interventions[0].last_alive_ns is None


def test_drives_that_switched_themselves_off_are_left_alone(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(10)
    bench.say(OFF)
    bench.wait(500)

    assert bench.sent == []


@pytest.mark.parametrize(("after_ms", "stops"), [(4, True), (5, False)])
def test_a_report_on_its_way_before_the_last_command_does_not_count(
    bench: Bench, after_ms: int, *, stops: bool
) -> None:
    bench.drive(100)
    bench.say(OFF, at_ms=1_090 + after_ms)
    bench.wait(100)

    assert bool(bench.sent) is stops


def test_a_report_of_before_does_not_end_it(bench: Bench) -> None:
    bench.drive(100)
    bench.say(OFF, at_ms=1_095)
    bench.say(ON)
    bench.wait(40)

    assert bench.times == [1_121, 1_131]


def test_a_report_of_the_moment_in_which_it_begins_does_not_end_it(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(20)
    bench.say(OFF, "left", at_ms=1_121)
    bench.wait(2)
    bench.say(OFF, "right")
    bench.wait(20)

    assert bench.times == [1_121, 1_131, 1_141]


@pytest.mark.parametrize(
    ("reports", "meaning", "end"), [(True, OFF, End.OFF), (True, ZERO, End.NODE), (False, MOVE, End.NODE)]
)
def test_report_at_the_time_of_the_first_stop_frame_counts(meaning: Meaning, end: End, *, reports: bool) -> None:
    bench = Bench(reports=reports)
    bench.drive(100)
    bench.wait(21)
    if meaning is MOVE:
        bench.beat()
    bench.say(meaning)
    bench.wait(1)

    assert bench.times == [1_121]
    assert ends(bench) == [end]


def test_commands_keep_nothing_alive(bench: Bench) -> None:
    """A recording of the node's commands goes on when the node is dead."""
    bench.drive(100)
    for _ in range(100):
        bench.say(MOVE)
        bench.wait(10)

    assert bench.times[0] == 1_121
    assert bench.watch.interventions[0].last_alive_ns == 1_090 * MS


@pytest.mark.parametrize("reports", [True, False])
def test_every_strange_command_is_answered_at_once_in_one_intervention(*, reports: bool) -> None:
    bench = Bench(reports=reports)
    bench.drive(100)
    bench.wait(30)
    bench.say(OFF)
    bench.wait(2_000)
    bench.sent.clear()
    for _ in range(200):
        bench.say(MOVE, "left")
        bench.wait(5)
        bench.say(OFF)
        bench.wait(2)
    answered = [bench.now_ms - 7 * n - 6 for n in range(200)]
    assert set(answered) <= set(bench.times)
    assert bench.watch.intervened == 2
    assert bench.watch.strange == 200
    last = bench.watch.interventions[-1]
    assert (last.cause, last.end) == (Cause.STRANGER, None)
    bench.say(OFF)
    bench.wait(1_200)

    assert last.end is (End.OFF if reports else End.TIME)


def test_stop_frames_go_on_until_strange_commands_have_been_missing_for_a_while() -> None:
    watch = Watch(Letters(), 0)
    for ms in range(1, 1_001):
        watch.step(ms * MS)
    watch.take_frame(Frame(1, b"left move", 1_000 * MS))
    assert watch.step(1_000 * MS) == STOP
    for name in ("left", "right"):
        watch.take_frame(Frame(1, f"{name} off".encode(), 1_010 * MS))
    for ms in range(1_001, 1_100):
        watch.step(ms * MS)
    watch.step(1_100 * MS)
    assert watch.present is not None
    watch.step(1_100 * MS + 1)

    assert watch.present is None


def test_commands_to_move_of_a_node_that_wants_none_are_strange(bench: Bench) -> None:
    for _ in range(10):
        bench.beat(is_on=False)
        bench.say(MOVE, "right")
        bench.wait(10)

    # The guard has just begun to watch: for as long as the limit it takes what is commanded for the node's.
    assert bench.times[0] == 1_041
    assert bench.watch.interventions[0].cause is Cause.STRANGER


def test_a_command_on_its_way_when_the_node_wants_the_motors_off_is_not_strange(bench: Bench) -> None:
    bench.drive(100)
    bench.beat(is_on=False)
    bench.wait(30)
    bench.say(MOVE, at_ms=1_120)
    bench.say(DISABLE)
    bench.wait(1)
    assert bench.watch.strange == 0
    bench.say(MOVE, at_ms=1_121)

    assert bench.watch.strange == 2


def test_a_guard_that_begins_while_the_robot_drives_learns_of_the_node_in_time(bench: Bench) -> None:
    for _ in range(3):
        bench.say(MOVE)
        bench.wait(10)
    bench.drive(500)

    assert bench.sent == []


def test_causes_and_ends_have_texts() -> None:
    assert [*Cause] == [
        "the node's heartbeats stopped",
        "motion was commanded that the node did not want",
        "a stopped node commanded motion without a zero before",
    ]
    assert [*End] == ["the drives report off", "the node is back", "the time for it is over"]


def test_a_node_that_is_back_with_zeros_ends_it(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(25)
    bench.say(ZERO, "left")
    bench.wait(10)
    assert not ends(bench)
    bench.say(DISABLE, "right")
    bench.wait(1)
    ended = len(bench.sent)
    bench.drive(200)

    assert ends(bench) == [End.NODE]
    assert len(bench.sent) == ended


def test_a_stopped_node_that_goes_on_commanding_is_stopped_at_once(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(30)
    bench.say(OFF)
    bench.wait(5_000)
    bench.sent.clear()
    bench.beat()
    bench.say(MOVE, "left")
    bench.wait(3)
    bench.say(MOVE, "left")
    bench.wait(3)
    again = list(bench.times)
    bench.say(ZERO)
    bench.wait(1)
    bench.drive(200)

    assert again == [6_131, 6_134]
    assert bench.times == again
    assert bench.watch.interventions[1].cause is Cause.DEFIANCE
    assert bench.watch.interventions[1].end is End.NODE


def test_a_node_that_sent_a_zero_after_it_was_stopped_may_move_again(bench: Bench) -> None:
    bench.drive(100)
    bench.wait(30)
    bench.say(OFF)
    bench.wait(100)
    bench.sent.clear()
    bench.say(ZERO)
    bench.drive(200)

    assert bench.sent == []


def test_where_drives_do_not_report_a_node_that_is_back_is_let_be() -> None:
    bench = Bench(reports=False)
    bench.drive(100)
    bench.say(OFF, at_ms=1_050)
    bench.wait(35)
    assert not ends(bench)
    bench.beat()
    bench.say(MOVE)
    bench.wait(1)
    ended = len(bench.sent)
    bench.drive(300)

    assert ends(bench) == [End.NODE]
    assert len(bench.sent) == ended
    assert bench.watch.intervened == 1


def test_heartbeats_alone_are_enough(bench: Bench) -> None:
    bench.drive(100)
    for _ in range(100):
        bench.watch.beat(bench.now_ms * MS, is_on=True)
        bench.wait(10)

    assert bench.sent == []
    assert bench.watch.heartbeats == 110
    bench.wait(100)
    assert bench.times[0] == 2_090 + 31


def test_heartbeats_that_want_the_motors_on_are_enough_to_stop_them(bench: Bench) -> None:
    bench.watch.beat(bench.now_ms * MS, is_on=True)
    bench.wait(31)

    assert bench.times == [1_031]


def test_a_heartbeat_that_wants_them_off_leaves_nothing_to_stop(bench: Bench) -> None:
    bench.drive(100)
    bench.watch.beat(bench.now_ms * MS, is_on=False)
    bench.wait(500)

    assert bench.sent == []


def test_heartbeat_does_not_override_disable_feedback(bench: Bench) -> None:
    bench.say(ON)
    bench.watch.beat(bench.now_ms * MS, is_on=False)
    bench.wait(31)

    assert bench.times == [1_031]


def test_a_guard_that_was_held_up_listens_again_before_it_judges(bench: Bench) -> None:
    bench.drive(100)
    bench.now_ms += 200
    bench.wait(16)
    assert bench.sent == []
    bench.wait(1)

    # Held up until 1301, it judges as if the last command had come half the limit before that, at 1286.
    assert bench.times == [1_317]
    assert bench.watch.interventions[0].last_alive_ns == 1_090 * MS


def test_a_pass_of_half_the_limit_is_no_hold_up(bench: Bench) -> None:
    bench.say(MOVE)
    for _ in range(2):
        bench.now_ms += 14
        bench.wait(1)
    assert bench.sent == []
    bench.wait(1)

    assert bench.times == [1_031]


def test_a_pass_of_more_than_that_is_one(bench: Bench) -> None:
    bench.say(MOVE)
    bench.now_ms += 15
    bench.wait(30)

    # Held up until 1016, it judges as if the command had come half the limit before that, at 1001.
    assert bench.times[0] == 1_032


def test_silence_while_the_bus_was_gone_is_excused(bench: Bench) -> None:
    bench.drive(100)
    for _ in range(100):
        bench.now_ms += 1
        bench.watch.excuse(bench.now_ms * MS)
    bench.wait(30)
    assert bench.sent == []
    bench.wait(1)

    assert bench.times == [1_231]


def test_interventions_are_all_counted_and_the_newest_kept(bench: Bench) -> None:
    for _ in range(130):
        bench.say(DISABLE)
        bench.drive(10)
        bench.wait(30)
        bench.say(OFF)
        bench.wait(10)

    assert bench.watch.intervened == 130
    assert len(bench.watch.interventions) == 100


def test_the_limit_can_be_set() -> None:
    watch = Watch(Letters(), 0, 50 * MS)
    watch.beat(0, is_on=True)
    at_ms = next(ms for ms in range(200) if watch.step(ms * MS))

    assert at_ms == 51


def test_the_limit_itself_is_still_allowed() -> None:
    watch = Watch(Letters(), 0)
    watch.beat(0, is_on=True)

    assert watch.step(15 * MS) == ()
    assert watch.step(30 * MS) == ()
    assert watch.step(30 * MS + 1) == STOP


def test_what_means_nothing_changes_nothing(bench: Bench) -> None:
    bench.drive(100)
    for _ in range(31):
        bench.watch.take_frame(Frame(9, b"noise", bench.now_ms * MS))
        bench.wait(1)

    assert bench.times == [1_121, 1_131]
    assert bench.watch.commands == 20
