# SPDX-License-Identifier: MIT
"""A link made of two: a bus first, and a serial line to fall back on."""

from collections.abc import Mapping
from typing import Final, Protocol

from segway_ecc.firmware_io.errors import LinkLostError
from segway_ecc.firmware_io.links.link import Frame, Link, LinkCounters, LinkState, NowNs

_NAMES: Final = ("can", "serial")

_ANSWERS_WITHIN_NS: Final = 350_000_000
"""A line in standby, asked ten times a second, is good while its last answer is no older than this."""
SEND_FAILURES: Final = 3
"""Commands in a row that could not be sent before the line counts as lost."""


class StandbyLink(Link, Protocol):
    """A link that can wait for its turn, answering now and then so that its health is known.

    It `is_active` while it carries the robot's commands, and so is to ask for telemetry in every cycle.
    """

    is_active: bool


class RedundantLink:
    """Two lines to the same drives of which one at a time is the owner: it alone carries what is sent.

    It passes from one line to the other only by `pass_over`; see `segway_ecc.firmware_io.switching`.

    Attributes:
        lines: The bus, and the line to fall back on.
        owner: Which of the two carries what is sent.
        aside: What the last `receive` found on the line in standby.
        silence_ns: A drive unheard for longer than this is lost on the line in use.
        dwell_ns: Shortest time between two changes, so that two bad lines do not take turns.
    """

    def __init__(
        self,
        bus: Link,
        fallback: StandbyLink,
        now_ns: NowNs,
        silence_ns: int = 20_000_000,
        dwell_ns: int = 1_000_000_000,
    ) -> None:
        """Join two lines; the bus is the first owner."""
        self.lines: tuple[Link, StandbyLink] = (bus, fallback)
        self.owner: Link = bus
        self.silence_ns = silence_ns
        self.dwell_ns = dwell_ns
        self._now_ns = now_ns
        self.aside: list[Frame] = []
        self._standby_received_ns: int | None = None
        self._failures = 0

    @property
    def counters(self) -> LinkCounters:
        """Those of the owner."""
        return self.owner.counters

    @property
    def description(self) -> str:
        """Both lines, and which one is the owner."""
        bus, fallback = (line.description for line in self.lines)
        return f"{fallback}, since {bus} was lost" if self.is_on_fallback else f"{bus}, {fallback} to fall back on"

    @property
    def state(self) -> LinkState:
        """That of the owner."""
        return self.owner.state

    @property
    def is_on_fallback(self) -> bool:
        """Whether the line to fall back on is the owner."""
        return self.owner is self.lines[1]

    @property
    def owner_name(self) -> str:
        """Which line is the owner: `can` or `serial`."""
        return _NAMES[self.is_on_fallback]

    @property
    def standby(self) -> Link:
        """The line that is not the owner."""
        return self.lines[not self.is_on_fallback]

    def open(self) -> None:
        """Open both lines; both must be there at the start."""
        for line in self.lines:
            line.open()

    def send(self, frame: Frame) -> bool:
        """Queue a frame on the owner."""
        was_sent = self.owner.send(frame)
        self._failures = 0 if was_sent else self._failures + 1
        return was_sent

    def receive(self) -> list[Frame]:
        """What has arrived on the owner; what arrived on the other line is kept `aside`.

        Raises:
            LinkLostError: Both lines are gone.
        """
        lost: list[str] = []
        received: dict[bool, list[Frame]] = {False: [], True: []}
        for line in self.lines:
            try:
                received[line is self.owner] = line.receive()
            except LinkLostError as error:
                lost.append(str(error))
        self.aside = received[False]
        if len(lost) == len(self.lines):
            raise LinkLostError("; ".join(lost))
        return received[True]

    def note_standby(self) -> None:
        """Note that a drive has just answered on the line in standby."""
        self._standby_received_ns = self._now_ns()

    def close(self) -> None:
        """Close both lines."""
        for line in self.lines:
            line.close()

    @property
    def health(self) -> Mapping[str, str]:
        """Of both lines."""
        return {
            "owner": self.owner_name,
            **{f"{name}.{k}": v for name, line in zip(_NAMES, self.lines, strict=True) for k, v in line.health.items()},
        }

    @property
    def trouble(self) -> str | None:
        """What the owner reports to be wrong with it, in a few words; None while all is well."""
        if self.owner.state not in (LinkState.ACTIVE, LinkState.WARNING):
            return str(self.owner.state)
        if self._failures >= SEND_FAILURES:
            return f"{self._failures} commands in a row could not be sent"
        return None

    @property
    def standby_is_good(self) -> bool:
        """Whether the line that is not the owner is up, and a drive has lately answered on it."""
        received_ns = self._standby_received_ns
        return (
            self.standby.state in (LinkState.ACTIVE, LinkState.WARNING)
            and received_ns is not None
            and self._now_ns() - received_ns <= _ANSWERS_WITHIN_NS
        )

    def pass_over(self) -> None:
        """Make the line in standby the owner.

        Nothing is sent on the line that is left: it would come out when that line is found again, and stop a robot that
        balances on the other.
        """
        self.owner = self.standby
        self.lines[1].is_active = self.is_on_fallback
        self._failures = 0
        self._standby_received_ns = None
