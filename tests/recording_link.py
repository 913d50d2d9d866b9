# SPDX-License-Identifier: MIT
"""A link that keeps what is sent, for one end of a line alone."""

from collections.abc import Mapping

from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState


class RecordingLink:
    """Nothing arrives on it; see `Link`. `frames` are those that were sent."""

    description = "recorded"
    state = LinkState.ACTIVE
    health: Mapping[str, str] = {}

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.frames: list[Frame] = []

    def open(self) -> None: ...

    def close(self) -> None: ...

    def receive(self) -> list[Frame]:
        return []

    def send(self, frame: Frame) -> bool:
        self.frames.append(frame)
        return True
