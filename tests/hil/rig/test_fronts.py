# SPDX-License-Identifier: MIT
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState
from segway_ecc.hil.rig.fronts import LinkFront

FRAME = Frame(0x120, b"angle")


class Wire:
    """A link that keeps what was asked of it."""

    description = "can0"
    state = LinkState.WARNING

    def __init__(self) -> None:
        self.counters = LinkCounters(received=7)
        self.health = {"state": "warning", "load": "12 %"}
        self.journal: list[object] = []
        self.takes = True

    def open(self) -> None:
        self.journal.append("open")

    def send(self, frame: Frame) -> bool:
        self.journal.append(frame)
        return self.takes

    def receive(self) -> list[Frame]:
        return [FRAME, FRAME]

    def close(self) -> None:
        self.journal.append("close")


def test_reports_the_state_of_the_link_behind() -> None:
    wire = Wire()
    front = LinkFront(wire)
    assert front.behind is wire
    assert front.counters is wire.counters
    assert (front.description, front.state, front.health) == ("can0", LinkState.WARNING, wire.health)


def test_does_what_the_link_behind_does() -> None:
    wire = Wire()
    front = LinkFront(wire)
    front.open()
    assert front.send(FRAME) is True
    wire.takes = False
    assert front.send(FRAME) is False
    assert front.receive() == [FRAME, FRAME]
    front.close()
    assert wire.journal == ["open", FRAME, FRAME, "close"]


def test_follows_the_link_behind_when_that_is_changed() -> None:
    front = LinkFront(Wire())
    other = Wire()
    front.behind = other
    front.open()
    assert other.journal == ["open"]
    assert front.counters is other.counters
