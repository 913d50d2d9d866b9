# SPDX-License-Identifier: MIT
"""A link in front of another: what passes is the other's, but for what a kind of front changes."""

from collections.abc import Mapping

from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState


class LinkFront:
    """Passes everything on to the link behind; a link that disturbs another overrides what it changes. See `Link`.

    Attributes:
        behind: The link behind.
    """

    def __init__(self, behind: Link) -> None:
        """Stand in front of `behind`."""
        self.behind = behind

    @property
    def counters(self) -> LinkCounters:
        """Those of the link behind."""
        return self.behind.counters

    @property
    def description(self) -> str:
        """That of the link behind."""
        return self.behind.description

    @property
    def state(self) -> LinkState:
        """That of the link behind."""
        return self.behind.state

    @property
    def health(self) -> Mapping[str, str]:
        """That of the link behind."""
        return self.behind.health

    def open(self) -> None:
        """Open the link behind; see `Link.open`."""
        self.behind.open()

    def send(self, frame: Frame) -> bool:
        """Send on the link behind; see `Link.send`."""
        return self.behind.send(frame)

    def receive(self) -> list[Frame]:
        """Take what has arrived on the link behind; see `Link.receive`."""
        return self.behind.receive()

    def close(self) -> None:
        """Close the link behind."""
        self.behind.close()
