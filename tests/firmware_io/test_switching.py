# SPDX-License-Identifier: MIT
"""When a redundant link changes lines, on the time line of a cycle of 10 ms."""

from dataclasses import dataclass, field

import pytest

from segway_ecc.firmware_io.switching import SWITCH_WITHIN_NS, Switching

MS = 1_000_000
START = 1_000 * MS


@dataclass
class Lines:
    """What `Switching` looks at of a redundant link."""

    trouble: str | None = None
    standby_is_good: bool = True
    is_on_fallback: bool = False
    silence_ns: int = 20 * MS
    dwell_ns: int = 1_000 * MS
    passes: list[int] = field(default_factory=list)

    @property
    def owner_name(self) -> str:
        return "serial" if self.is_on_fallback else "can"

    def pass_over(self) -> None:
        self.is_on_fallback = not self.is_on_fallback


class Bench:
    def __init__(self) -> None:
        self.now_ns = START
        self.lines = Lines()
        self.switching = Switching(self.lines, lambda: self.now_ns)  # type: ignore[arg-type]
        self.judge(0)

    def judge(self, age_ms: float | None, other_age_ms: float = 0.0, *, armed: bool = True) -> str | None:
        """Judge with two drives heard so long ago; None is never."""
        return self.switching.judge(self.heard(age_ms, other_age_ms), is_armed=armed)

    def measure(self, age_ms: float | None, other_age_ms: float = 0.0, *, ready: bool = False) -> list[str]:
        return list(self.switching.measure(self.heard(age_ms, other_age_ms), is_ready=ready))

    def heard(self, *ages_ms: float | None) -> list[int | None]:
        return [None if age is None else self.now_ns - round(age * MS) for age in ages_ms]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_healthy_line_is_kept(bench: Bench) -> None:
    assert bench.judge(20.0, 20.0) is None
    assert not bench.lines.is_on_fallback
    assert not bench.switching.is_under_way


@pytest.mark.parametrize("ages", [(20.001, 0.0), (0.0, 20.001)])
def test_one_silent_drive_is_reason_enough(bench: Bench, ages: tuple[float, float]) -> None:
    assert bench.judge(*ages) == "link: from can to serial: no good frame for 20.0 ms"
    assert bench.lines.is_on_fallback


def test_silence_of_an_unseen_drive_counts_from_the_first_pass(bench: Bench) -> None:
    bench.now_ns += 20 * MS
    assert bench.judge(None) is None
    bench.now_ns += 1 * MS
    assert bench.judge(None) == "link: from can to serial: no good frame for 21.0 ms"


def test_link_trouble_is_the_reason_at_once(bench: Bench) -> None:
    bench.lines.trouble = "bus-off"
    assert bench.judge(0.0) == "link: from can to serial: bus-off"


def test_without_a_good_line_to_pass_to_nothing_is_done(bench: Bench) -> None:
    bench.lines.standby_is_good = False
    bench.lines.trouble = "bus-off"
    assert bench.judge(500.0) is None
    assert bench.switching.count == 0


def test_two_bad_lines_do_not_take_turns(bench: Bench) -> None:
    bench.judge(30.0)
    bench.now_ns += 1_000 * MS - 1
    assert bench.judge(900.0) is None, "the shortest time between two changes has not passed"
    bench.now_ns += 1
    assert bench.judge(900.0) == "link: from serial to can: no good frame for 900.0 ms"


def test_there_is_no_way_back_while_the_robot_is_armed(bench: Bench) -> None:
    bench.judge(30.0)
    for _ in range(1_000):
        bench.now_ns += 10 * MS
        assert bench.judge(0.0, armed=True) is None
    assert bench.lines.is_on_fallback


def test_disarmed_it_goes_back_once_the_bus_has_been_good_for_a_while(bench: Bench) -> None:
    bench.judge(30.0)
    bench.now_ns += 5_000 * MS
    bench.lines.standby_is_good = False
    assert bench.judge(0.0, armed=False) is None
    bench.lines.standby_is_good = True
    assert bench.judge(0.0, armed=False) is None, "good only since now"
    bench.now_ns += 1_000 * MS - 1
    assert bench.judge(0.0, armed=False) is None
    bench.now_ns += 1
    told = bench.judge(0.0, armed=False)
    assert told == "link: from serial to can: the bus is good again and the robot is disarmed"
    assert not bench.lines.is_on_fallback


def test_a_bus_that_was_bad_in_between_starts_anew(bench: Bench) -> None:
    bench.judge(30.0)
    bench.now_ns += 2_000 * MS
    bench.judge(0.0)
    bench.lines.standby_is_good = False
    bench.judge(0.0)
    bench.lines.standby_is_good = True
    bench.now_ns += 1 * MS
    assert bench.judge(0.0, armed=False) is None


def test_both_gaps_are_measured_from_the_last_good_frame(bench: Bench) -> None:
    bench.judge(25.0, 0.0)
    assert bench.measure(25.0, 1.0) == []
    bench.now_ns += 10 * MS
    assert bench.measure(2.0, 35.0) == [], "one drive has not been heard yet"
    assert bench.measure(2.0, 1.0) == ["link: telemetry is back 34.0 ms after the last good frame"]
    bench.now_ns += 10 * MS
    assert bench.measure(2.0, 1.0, ready=True) == ["link: the motors follow again 45.0 ms after the last good frame"]
    assert bench.measure(2.0, 1.0, ready=True) == []
    (switch,) = bench.switching.switches
    assert (switch.telemetry_gap_ns, switch.torque_gap_ns) == (34 * MS, 45 * MS)
    assert bench.switching.health == {
        "link.switches": "1",
        "link.last_switch": "no good frame for 25.0 ms",
        "link.last_telemetry_gap_ms": "34.0",
        "link.last_torque_gap_ms": "45.0",
    }


def test_values_may_be_a_little_old_while_the_lines_change_and_no_longer(bench: Bench) -> None:
    bench.judge(30.0)
    bench.now_ns += SWITCH_WITHIN_NS
    assert bench.switching.is_under_way
    bench.now_ns += 1
    assert not bench.switching.is_under_way


def test_nothing_is_measured_where_nothing_changed(bench: Bench) -> None:
    assert bench.measure(0.0, ready=True) == []
    assert bench.switching.health == {"link.switches": "0"}


def test_the_changes_kept_are_bounded_and_all_counted(bench: Bench) -> None:
    for _ in range(100):
        bench.now_ns += 1_000 * MS
        bench.judge(30.0)
    assert bench.switching.count == 100
    assert len(bench.switching.switches) == 32
