# SPDX-License-Identifier: MIT
"""The guard at work on links that do what a test says."""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pytest

from segway_ecc.firmware_io.drives.stopper import Meaning, Observation
from segway_ecc.firmware_io.errors import BusNotFoundError, LinkLostError
from segway_ecc.firmware_io.guard.guard import Guard, describe
from segway_ecc.firmware_io.guard.watch import Cause, End, Intervention, Watch
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState

MS = 1_000_000
STOP = Frame(0x50, b"stop")


class Wire:
    """A link with what arrives on it, a list at a time."""

    def __init__(self, journal: list[str], name: str) -> None:
        self.counters = LinkCounters()
        self.description = name
        self.state = LinkState.ACTIVE
        self.health: Mapping[str, str] = {}
        self.arriving: list[list[Frame]] = []
        self.sent: list[Frame] = []
        self.is_gone = False
        self.received = 0
        self._journal = journal

    def open(self) -> None:
        self._journal.append(f"open {self.description}")

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def receive(self) -> list[Frame]:
        self.received += 1
        if self.is_gone:
            raise LinkLostError(f"{self.description} is gone")
        return self.arriving.pop(0) if self.arriving else []

    def close(self) -> None:
        self._journal.append(f"close {self.description}")


class Board:
    drives: Sequence[str] = ("board",)
    reports = True

    def read(self, frame: Frame) -> Observation | None:
        return Observation("board", Meaning(frame.data.decode()))

    def stop(self) -> Sequence[Frame]:
        return [STOP]


class Bench:
    def __init__(self, make_beats: Callable[[], Any]) -> None:
        self.now_ms = 0
        self.journal: list[str] = []
        self.wire = Wire(self.journal, "bus")
        self.beats = make_beats()
        self.watch = Watch(Board(), 0)
        self.slept: list[int] = []
        self.passes = 5
        self.guard = Guard(self.wire, self.beats, self.watch, self)

    def now_ns(self) -> int:
        return self.now_ms * MS

    def wall_ns(self) -> int:
        return 0

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.slept.append(deadline_ns - self.now_ms * MS)
        self.now_ms = deadline_ns // MS
        if len(self.slept) == self.passes:
            self.guard.stop("enough")
        assert len(self.slept) <= self.passes, "it goes on though it was stopped"

    def pass_(self, ms: int = 1) -> None:
        for _ in range(ms):
            self.now_ms += 1
            self.guard.step()

    def say(self, meaning: Meaning) -> None:
        self.wire.arriving.append([Frame(1, str(meaning).encode(), self.now_ms * MS)])


@pytest.fixture
def bench(guarded: Any) -> Bench:
    return Bench(lambda: guarded("cart-can").beats)


def test_it_stops_the_drives_over_the_link_that_it_listens_on(bench: Bench) -> None:
    bench.say(Meaning.MOVE)
    bench.pass_(31)

    assert bench.wire.sent == [STOP]


def test_it_answers_each_pass_before_it_sends(bench: Bench) -> None:
    bench.say(Meaning.MOVE)

    def send(frame: Frame) -> bool:
        bench.beats.answered.append(f"sent {frame.data.decode()}")
        return True

    bench.wire.send = send  # type: ignore[method-assign]
    bench.pass_(31)

    assert set(bench.beats.answered[:-2]) == {""}
    assert bench.beats.answered[-2:] == ["the node's heartbeats stopped", "sent stop"]


def test_heartbeats_are_taken_after_the_frames_that_they_precede(bench: Bench) -> None:
    """A node that arms sends its heartbeat first: what is there with the first command that moves is no stranger."""
    for _ in range(50):
        bench.beats.beat(is_on=False)
        bench.pass_()
    frames = bench.wire.receive

    def receive() -> list[Frame]:
        found = frames()
        if found:
            bench.beats.beat(is_on=True)
        return found

    bench.wire.receive = receive  # type: ignore[method-assign]
    bench.say(Meaning.MOVE)
    bench.pass_()

    assert bench.watch.strange == 0


def test_interventions_in_a_row_are_logged_once_a_second(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(100):
        bench.say(Meaning.DISABLE)
        bench.pass_()
        bench.beats.beat(is_on=True)
        bench.pass_(33)
        bench.say(Meaning.OFF)
        bench.pass_(8)

    assert bench.watch.intervened == 100
    assert len([text for text in caplog.messages if text.startswith("stopping")]) == 5
    assert len([text for text in caplog.messages if text.startswith("stopped")]) == 5


def test_an_intervention_a_second_after_the_last_is_logged(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(2):
        bench.beats.beat(is_on=True)
        bench.pass_(40)
        bench.say(Meaning.OFF)
        bench.pass_(960)

    assert [text.split()[0] for text in caplog.messages] == ["stopping", "stopped"] * 2


def test_passes_are_quicker_while_the_drives_are_being_stopped(bench: Bench) -> None:
    bench.say(Meaning.MOVE)
    bench.passes = 20
    bench.guard.run()

    assert bench.slept == [2 * MS] * 16 + [MS // 2] * 4


def test_strange_commands_without_end_are_one_message(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    for _ in range(300):
        bench.say(Meaning.MOVE)
        bench.pass_(10)

    assert caplog.messages == ["stopping the drives: the node's heartbeats stopped"]


def test_intervention_is_logged_once(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.say(Meaning.MOVE)
    bench.pass_(33)
    assert caplog.messages == ["stopping the drives: the node's heartbeats stopped"]
    bench.say(Meaning.OFF)
    bench.pass_(100)

    (_, message) = caplog.messages
    assert message == (
        "stopped the drives: the node's heartbeats stopped; no heartbeat was ever received, 1 frames over 0 ms, "
        "until the drives report off"
    )


def test_it_takes_heartbeats(bench: Bench) -> None:
    bench.say(Meaning.MOVE)
    for _ in range(100):
        bench.beats.beat(is_on=True)
        bench.pass_()
    assert bench.wire.sent == []
    assert bench.watch.heartbeats == 100
    bench.beats.beat(is_on=False)
    bench.pass_(50)

    assert bench.wire.sent == []


def test_it_takes_all_that_has_piled_up_before_it_judges(bench: Bench) -> None:
    bench.wire.arriving = [[Frame(1, b"move", 1 * MS)] for _ in range(10)] + [[Frame(1, b"disable", 2 * MS)]]
    bench.pass_(100)

    assert bench.wire.sent == []
    assert bench.watch.commands == 11


def test_a_bus_that_never_falls_quiet_does_not_hold_a_pass_up(bench: Bench) -> None:
    bench.wire.arriving = [[Frame(1, b"zero", 1 * MS)] for _ in range(1_000)]
    bench.pass_()

    assert bench.wire.received == 20


def test_lost_bus_is_logged_once_and_recovers(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.say(Meaning.MOVE)
    bench.pass_(10)
    bench.wire.is_gone = True
    bench.beats.answered.clear()
    bench.pass_(100)
    assert bench.beats.answered == [""] * 100
    assert bench.wire.sent == []
    bench.wire.is_gone = False
    bench.pass_(30)
    assert bench.wire.sent == []
    bench.pass_()

    assert bench.wire.sent == [STOP]
    assert caplog.messages[:2] == [
        "bus is gone: nothing is guarded until it is back",
        "bus is back, and guarded",
    ]
    bench.pass_(100)
    assert caplog.messages[2:] == ["stopping the drives: the node's heartbeats stopped"]


def test_it_runs_until_it_is_stopped_and_closes_everything(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.guard.run()

    assert bench.slept == [2 * MS] * 5
    assert bench.journal == ["open bus", "close bus"]
    assert caplog.messages == ["guard on bus"]


@pytest.mark.parametrize(("passes", "sent"), [(15, []), (17, [STOP])])
def test_it_guards_from_when_it_runs_and_not_from_before(bench: Bench, passes: int, sent: list[Frame]) -> None:
    bench.say(Meaning.MOVE)
    bench.now_ms = 500
    bench.passes = passes  # of 2 ms, the last of them not looked after; the limit is 30 ms
    bench.guard.run()

    assert bench.wire.sent == sent


def test_a_bus_that_is_not_there_ends_it(bench: Bench) -> None:
    def fail() -> None:
        raise BusNotFoundError("no bus")

    bench.wire.open = fail  # type: ignore[method-assign]
    with pytest.raises(BusNotFoundError):
        bench.guard.run()

    assert bench.journal == ["close bus"]


@pytest.mark.parametrize(
    ("last_ns", "text"),
    [
        (None, "no heartbeat was ever received"),
        (1_000 * MS, "32.5 ms after the last heartbeat"),
    ],
)
def test_intervention_is_described_in_one_line(last_ns: int | None, text: str) -> None:
    done = Intervention(Cause.SILENCE, last_ns, 1_032_500_000, 1_062_500_000, 8, End.TIME)

    assert describe(done) == (
        f"stopped the drives: the node's heartbeats stopped; {text}, 8 frames over 30 ms, until the time for it is over"
    )
