# SPDX-License-Identifier: MIT
"""The drives' link, and a line beside it on which a sensor of the robot sends."""

import contextlib
from collections.abc import Mapping

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState


class JoinedLink:
    """Both as one link; see `Link`. What is sent goes to the drives; state and counts are those of their link.

    A line that is lost leaves its sensor silent, as its driver reports; the drives are reached all the same.

    Attributes:
        main: The drives' link.
        aside: The sensor's line.
    """

    def __init__(self, main: Link, aside: Link) -> None:
        """Join the two."""
        self.main = main
        self.aside = aside

    @property
    def counters(self) -> LinkCounters:
        """Those of the drives' link."""
        return self.main.counters

    @property
    def description(self) -> str:
        """Both."""
        return f"{self.main.description}; {self.aside.description}"

    @property
    def state(self) -> LinkState:
        """That of the drives' link."""
        return self.main.state

    @property
    def health(self) -> Mapping[str, str]:
        """Of both."""
        return {**self.main.health, **{f"imu.{name}": text for name, text in self.aside.health.items()}}

    def open(self) -> None:
        """Open both; both must be there at the start."""
        self.main.open()
        self.aside.open()

    def send(self, frame: Frame) -> bool:
        """Send to the drives."""
        return self.main.send(frame)

    def receive(self) -> list[Frame]:
        """Take what has arrived on both.

        Raises:
            LinkLostError: The drives' link is gone; what the sensor sent meanwhile is discarded, being old later.
        """
        aside: list[Frame] = []
        with contextlib.suppress(LinkLostError):
            aside = self.aside.receive()
        return self.main.receive() + aside

    def close(self) -> None:
        """Close both."""
        self.main.close()
        self.aside.close()
