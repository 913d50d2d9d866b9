# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState
from segway_ecc.firmware_io.links.redundant_link import SEND_FAILURES, RedundantLink

MS = 1_000_000
COMMAND = Frame(0x110, b"torque")
TELEMETRY = Frame(0x120, b"angle", 5 * MS)


class Wire:
    """A link that does what it is told."""

    def __init__(self, name: str, journal: list[str]) -> None:
        self.counters = LinkCounters()
        self.description = name
        self.state = LinkState.ACTIVE
        self.is_active = False
        self.is_gone = False
        self.accepts = True
        self.arrived: list[Frame] = []
        self.sent: list[Frame] = []
        self._journal = journal

    @property
    def health(self) -> dict[str, str]:
        return {"state": str(self.state)}

    def open(self) -> None:
        self._journal.append(f"open {self.description}")

    def send(self, frame: Frame) -> bool:
        if self.accepts:
            self.sent.append(frame)
        return self.accepts

    def receive(self) -> list[Frame]:
        if self.is_gone:
            raise LinkLostError(f"{self.description} is gone")
        frames, self.arrived = self.arrived, []
        return frames

    def close(self) -> None:
        self._journal.append(f"close {self.description}")


class Bench:
    def __init__(self) -> None:
        self.now_ns = 1_000 * MS
        self.journal: list[str] = []
        self.bus, self.line = Wire("can", self.journal), Wire("serial", self.journal)
        self.link = RedundantLink(self.bus, self.line, lambda: self.now_ns)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_both_lines_are_opened_and_closed(bench: Bench) -> None:
    bench.link.open()
    bench.link.close()
    assert bench.journal == ["open can", "open serial", "close can", "close serial"]


def test_commands_go_to_the_owner_alone(bench: Bench) -> None:
    assert bench.link.send(COMMAND)
    assert (bench.bus.sent, bench.line.sent) == ([COMMAND], [])
    bench.link.pass_over()
    assert bench.link.send(COMMAND)
    assert (bench.bus.sent, bench.line.sent) == ([COMMAND], [COMMAND])


def test_passing_over_sends_nothing_by_itself(bench: Bench) -> None:
    bench.link.pass_over()
    bench.link.pass_over()
    assert (bench.bus.sent, bench.line.sent) == ([], [])


def test_the_line_to_fall_back_on_knows_when_it_is_the_owner(bench: Bench) -> None:
    seen = []
    for _ in range(3):
        seen.append((bench.line.is_active, bench.link.is_on_fallback))
        bench.link.pass_over()
    assert seen == [(False, False), (True, True), (False, False)]


def test_what_arrives_on_the_other_line_is_kept_aside(bench: Bench) -> None:
    bench.bus.arrived, bench.line.arrived = [TELEMETRY], [COMMAND]
    assert (bench.link.receive(), bench.link.aside) == ([TELEMETRY], [COMMAND])
    bench.link.pass_over()
    bench.bus.arrived, bench.line.arrived = [TELEMETRY], [COMMAND]
    assert (bench.link.receive(), bench.link.aside) == ([COMMAND], [TELEMETRY])
    assert (bench.link.receive(), bench.link.aside) == ([], [])


def test_line_that_was_left_must_answer_again(bench: Bench) -> None:
    bench.link.note_standby()
    bench.link.pass_over()
    assert not bench.link.standby_is_good


@pytest.mark.parametrize("on_fallback", [False, True])
def test_one_lost_line_does_not_raise_and_two_do(bench: Bench, on_fallback: bool) -> None:  # noqa: FBT001 - a parameter
    if on_fallback:
        bench.link.pass_over()
    bench.bus.is_gone = True
    bench.line.arrived = [TELEMETRY]
    assert bench.link.receive() == ([TELEMETRY] if on_fallback else [])
    bench.line.is_gone = True
    with pytest.raises(LinkLostError, match=r"^can is gone; serial is gone$"):
        bench.link.receive()


@pytest.mark.parametrize("on_fallback", [False, True])
def test_standby_line_is_good_while_it_is_up_and_answered_lately(bench: Bench, on_fallback: bool) -> None:  # noqa: FBT001 - a parameter
    if on_fallback:
        bench.link.pass_over()
    standby = bench.bus if on_fallback else bench.line
    seen = [bench.link.standby_is_good]
    bench.link.note_standby()
    bench.now_ns += 350 * MS
    for state in LinkState:
        standby.state = state
        seen.append(bench.link.standby_is_good)
    standby.state = LinkState.ACTIVE
    bench.now_ns += 1
    seen.append(bench.link.standby_is_good)
    # Never heard; then active, warning, passive, bus-off and gone; then heard too long ago.
    assert seen == [False, True, True, False, False, False, False]


@pytest.mark.parametrize("state", [LinkState.PASSIVE, LinkState.BUS_OFF, LinkState.GONE])
def test_a_state_in_which_nothing_arrives_is_trouble(bench: Bench, state: LinkState) -> None:
    bench.line.state = state
    of_the_other = bench.link.trouble
    bench.bus.state = state
    assert (of_the_other, bench.link.trouble, bench.link.state) == (None, str(state), state)


def test_a_warning_is_no_trouble_yet(bench: Bench) -> None:
    bench.bus.state = LinkState.WARNING
    assert bench.link.trouble is None


def test_commands_that_cannot_be_sent_are_trouble_when_several_fail_in_a_row(bench: Bench) -> None:
    bench.bus.accepts = False
    for _ in range(SEND_FAILURES - 1):
        assert bench.link.send(COMMAND) is False
    bench.bus.accepts = True
    bench.link.send(COMMAND)
    bench.bus.accepts = False
    for _ in range(SEND_FAILURES - 1):
        bench.link.send(COMMAND)
    before = bench.link.trouble
    bench.link.send(COMMAND)
    after = bench.link.trouble
    bench.link.pass_over()
    assert (before, after, bench.link.trouble) == (None, "3 commands in a row could not be sent", None)


def test_health_covers_both_lines_and_the_owner(bench: Bench) -> None:
    assert bench.link.description == "can, serial to fall back on"
    assert bench.link.health == {"owner": "can", "can.state": "active", "serial.state": "active"}
    assert bench.link.counters is bench.bus.counters
    bench.link.pass_over()
    assert bench.link.description == "serial, since can was lost"
    assert bench.link.health["owner"] == "serial"
    assert bench.link.counters is bench.line.counters
