# SPDX-License-Identifier: MIT
"""The bus of devices that are on a serial line alone: nothing passes on it."""

from collections.abc import Mapping

from segway_ecc.firmware_io.links.link import Frame, LinkCounters, LinkState


class NoBus:
    """A bus on which nothing passes; see `Link`."""

    description = "no bus"
    state = LinkState.ACTIVE

    def __init__(self) -> None:
        """Count nothing."""
        self.counters = LinkCounters()

    @property
    def health(self) -> Mapping[str, str]:
        """Nothing to report."""
        return {}

    def open(self) -> None:
        """Do nothing."""

    def send(self, frame: Frame) -> bool:
        """Discard a frame: nobody is there to take it."""
        del frame
        return True

    def receive(self) -> list[Frame]:
        """Nothing."""
        return []

    def close(self) -> None:
        """Do nothing."""
