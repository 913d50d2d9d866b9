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
        self.ears, self.voice = Wire(self.journal, "ears"), Wire(self.journal, "voice")
        self.beats = make_beats()
        self.watch = Watch(Board(), 0)
        self.slept: list[int] = []
        self.passes = 5
        self.guard = Guard(self.ears, self.voice, self.beats, self.watch, self)

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
        self.ears.arriving.append([Frame(1, str(meaning).encode(), self.now_ms * MS)])


@pytest.fixture
def bench(guarded: Any) -> Bench:
    return Bench(lambda: guarded("cart-can").beats)


def test_it_listens_with_one_link_and_speaks_with_the_other(bench: Bench) -> None:
    bench.say(Meaning.MOVE)
    bench.pass_(31)

    assert bench.voice.sent == [STOP]
    assert bench.ears.sent == []


def test_intervention_is_logged_once(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.say(Meaning.MOVE)
    bench.pass_(33)
    assert caplog.messages == []
    bench.say(Meaning.OFF)
    bench.pass_(100)

    (message,) = caplog.messages
    assert message == (
        "stopped the drives: commands stopped; 31.0 ms after the last command, 1 frames over 0 ms, "
        "until the drives report off"
    )


def test_it_takes_heartbeats(bench: Bench) -> None:
    bench.say(Meaning.MOVE)
    for _ in range(100):
        bench.beats.beat(is_on=True)
        bench.pass_()
    assert bench.voice.sent == []
    assert bench.watch.heartbeats == 100
    bench.beats.beat(is_on=False)
    bench.pass_(50)

    assert bench.voice.sent == []


def test_it_takes_all_that_has_piled_up_before_it_judges(bench: Bench) -> None:
    bench.ears.arriving = [[Frame(1, b"move", 1 * MS)] for _ in range(10)] + [[Frame(1, b"disable", 2 * MS)]]
    bench.pass_(100)

    assert bench.voice.sent == []
    assert bench.watch.commands == 11


def test_a_bus_that_never_falls_quiet_does_not_hold_a_pass_up(bench: Bench) -> None:
    bench.ears.arriving = [[Frame(1, b"zero", 1 * MS)] for _ in range(1_000)]
    bench.pass_()

    assert bench.ears.received == 20


def test_it_drains_the_link_that_it_speaks_on(bench: Bench) -> None:
    bench.voice.arriving = [[Frame(1, b"move")]] * 5
    bench.pass_(10)

    assert bench.voice.arriving == []
    assert bench.watch.commands == 0


def test_lost_bus_is_logged_once_and_recovers(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.say(Meaning.MOVE)
    bench.pass_(10)
    bench.ears.is_gone = bench.voice.is_gone = True
    bench.pass_(100)
    assert bench.voice.sent == []
    bench.ears.is_gone = bench.voice.is_gone = False
    bench.pass_(30)
    assert bench.voice.sent == []
    bench.pass_()

    assert bench.voice.sent == [STOP]
    assert caplog.messages[:2] == [
        "ears is gone: nothing is guarded until it is back",
        "ears is back, and guarded",
    ]
    bench.pass_(100)
    assert len(caplog.messages) == 2


def test_it_runs_until_it_is_stopped_and_closes_everything(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    bench.guard.run()

    assert bench.slept == [2 * MS] * 5
    assert bench.journal == ["open ears", "open voice", "close voice", "close ears"]
    assert caplog.messages == ["guard on ears"]


@pytest.mark.parametrize(("passes", "sent"), [(15, []), (17, [STOP])])
def test_it_guards_from_when_it_runs_and_not_from_before(bench: Bench, passes: int, sent: list[Frame]) -> None:
    bench.say(Meaning.MOVE)
    bench.now_ms = 500
    bench.passes = passes  # of 2 ms, the last of them not looked after; the limit is 30 ms
    bench.guard.run()

    assert bench.voice.sent == sent


def test_a_bus_that_is_not_there_ends_it(bench: Bench) -> None:
    def fail() -> None:
        raise BusNotFoundError("no bus")

    bench.voice.open = fail  # type: ignore[method-assign]
    with pytest.raises(BusNotFoundError):
        bench.guard.run()

    assert bench.journal == ["open ears", "close voice", "close ears"]


@pytest.mark.parametrize(
    ("last_ns", "text"),
    [
        (None, "no command was ever received"),
        (1_000 * MS, "32.5 ms after the last command"),
    ],
)
def test_intervention_is_described_in_one_line(last_ns: int | None, text: str) -> None:
    done = Intervention(Cause.SILENCE, last_ns, 1_032_500_000, 1_062_500_000, 8, End.TIME)

    assert describe(done) == (
        f"stopped the drives: commands stopped; {text}, 8 frames over 30 ms, until the time for it is over"
    )
