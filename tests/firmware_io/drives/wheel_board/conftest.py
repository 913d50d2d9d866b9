import pytest

from firmware_io.links.link import Frame, Link, LinkCounters


class _MemoryLink:
    """A link whose two ends are lists in this process."""

    description = "memory"

    def __init__(self, arrived: list[Frame], sent: list[Frame], events: list[str]) -> None:
        self.counters = LinkCounters()
        self._arrived, self._sent, self._events = arrived, sent, events

    def open(self) -> None:
        self._events.append("open")

    def send(self, frame: Frame) -> bool:
        self._sent.append(frame)
        self._events.append("send")
        return True

    def receive(self) -> list[Frame]:
        frames = list(self._arrived)
        self._arrived.clear()
        return frames

    def close(self) -> None:
        self._events.append("close")


@pytest.fixture
def arrived() -> list[Frame]:
    """Frames that wait to be received."""
    return []


@pytest.fixture
def sent() -> list[Frame]:
    """Frames that were sent."""
    return []


@pytest.fixture
def events() -> list[str]:
    """What was done to the link, in order."""
    return []


@pytest.fixture
def link(arrived: list[Frame], sent: list[Frame], events: list[str]) -> Link:
    """The near end of a link in memory."""
    return _MemoryLink(arrived, sent, events)
