# SPDX-License-Identifier: MIT
from collections.abc import Mapping

import pytest

from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState


class _MemoryLink:
    """A link whose sending end is a list in this process."""

    description = "memory"
    state = LinkState.ACTIVE

    def __init__(self, sent: list[Frame]) -> None:
        self.counters = LinkCounters()
        self._sent = sent

    @property
    def health(self) -> Mapping[str, str]:
        return {}

    def open(self) -> None:
        """Nothing to open."""

    def send(self, frame: Frame) -> bool:
        self._sent.append(frame)
        return True

    def receive(self) -> list[Frame]:
        return []

    def close(self) -> None:
        """Nothing to close."""


@pytest.fixture
def sent() -> list[Frame]:
    """Frames that were sent."""
    return []


@pytest.fixture
def link(sent: list[Frame]) -> Link:
    """The near end of a link in memory."""
    return _MemoryLink(sent)
