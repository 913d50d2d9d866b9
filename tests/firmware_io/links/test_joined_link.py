# SPDX-License-Identifier: MIT
"""A sensor's line beside the drives' link."""

from collections.abc import Mapping

import pytest

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.joined_link import JoinedLink
from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState


class MemoryLink:
    """A link in memory."""

    def __init__(self, name: str) -> None:
        self.description = name
        self.state = LinkState.ACTIVE
        self.counters = LinkCounters()
        self.arrived: list[Frame] = []
        self.sent: list[Frame] = []
        self.is_open = self.is_lost = False

    @property
    def health(self) -> Mapping[str, str]:
        return {"state": str(self.state)}

    def open(self) -> None:
        self.is_open = True

    def send(self, frame: Frame) -> bool:
        self.sent.append(frame)
        return True

    def receive(self) -> list[Frame]:
        frames, self.arrived = self.arrived, []
        if self.is_lost:
            raise LinkLostError(self.description)
        return frames

    def close(self) -> None:
        self.is_open = False


@pytest.fixture
def ends() -> tuple[MemoryLink, MemoryLink]:
    return MemoryLink("drives"), MemoryLink("imu")


def test_what_arrives_on_either_is_received_and_what_is_sent_goes_to_the_drives(
    ends: tuple[MemoryLink, MemoryLink],
) -> None:
    main, aside = ends
    link = JoinedLink(main, aside)
    link.open()
    assert [end.is_open for end in ends] == [True, True]
    main.arrived, aside.arrived = [Frame(1, b"a")], [Frame(2, b"b")]
    assert [frame.arbitration_id for frame in link.receive()] == [1, 2]
    assert link.send(Frame(3, b""))
    assert (len(main.sent), aside.sent) == (1, [])
    assert link.description == "drives; imu"
    assert link.counters is main.counters
    assert link.state is main.state
    assert link.health == {"state": "active", "imu.state": "active"}
    link.close()
    assert [end.is_open for end in ends] == [False, False]


def test_a_lost_line_of_the_sensor_leaves_the_drives(ends: tuple[MemoryLink, MemoryLink]) -> None:
    main, aside = ends
    aside.is_lost = True
    main.arrived = [Frame(1, b"a")]
    assert len(JoinedLink(main, aside).receive()) == 1


def test_what_the_sensor_sent_while_the_drives_were_lost_is_not_received_later(
    ends: tuple[MemoryLink, MemoryLink],
) -> None:
    main, aside = ends
    link = JoinedLink(main, aside)
    main.is_lost = True
    aside.arrived = [Frame(2, b"old")]
    with pytest.raises(LinkLostError, match="drives"):
        link.receive()
    main.is_lost = False
    assert link.receive() == []
