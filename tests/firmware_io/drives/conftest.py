# SPDX-License-Identifier: MIT
import pytest

from segway_ecc.firmware_io.links.link import Frame, Link
from tests.recording_link import RecordingLink


class _NearEnd(RecordingLink):
    """The near end of a link: what is sent lands in a list."""

    description = "memory"

    def receive(self) -> list[Frame]:
        raise AssertionError("a drive is handed its frames, it does not take them itself")


@pytest.fixture
def link() -> Link:
    """The near end of a link in memory."""
    return _NearEnd()


@pytest.fixture
def sent(link: _NearEnd) -> list[Frame]:
    """Frames that were sent over it."""
    return link.frames
