"""Both ends of the wheel board's conversation: counters put on and checked, everything refused counted."""

from collections import Counter
from collections.abc import Iterator
from typing import NamedTuple

from firmware_io.drives.wheel_board.frames import FrameId, FrameRefusedError, Payload, decode, encode
from firmware_io.integrity import CounterCheck, Refusal
from firmware_io.links.link import Frame, Link


class Received(NamedTuple):
    """A frame that passed every check."""

    frame_id: FrameId
    payload: Payload
    received_ns: int


class Endpoint:
    """Sends payloads over a link and yields those that arrive intact.

    Attributes:
        refused: Frames refused, by cause.
    """

    def __init__(self, link: Link, listen_to: frozenset[FrameId]) -> None:
        """Speak over `link`; frames with other ids than `listen_to` are somebody else's and are passed over."""
        self.refused: Counter[Refusal] = Counter()
        self._link = link
        self._send_counter = dict.fromkeys(FrameId, 0)
        self._checks = {frame_id: CounterCheck() for frame_id in listen_to}

    @property
    def lost(self) -> int:
        """Frames missing between those received, by their counters."""
        return sum(check.lost for check in self._checks.values())

    def send(self, frame_id: FrameId, payload: Payload) -> bool:
        """Send a payload; False where the link dropped it."""
        counter = self._send_counter[frame_id]
        self._send_counter[frame_id] = counter + 1
        return self._link.send(Frame(frame_id, encode(frame_id, payload, counter)))

    def receive(self) -> Iterator[Received]:
        """Everything that has arrived intact, oldest first."""
        for frame in self._link.receive():
            received = self._check(frame)
            if received is not None:
                yield received

    def _check(self, frame: Frame) -> Received | None:
        check = None if frame.is_extended else self._checks.get(frame.arbitration_id)  # type: ignore[call-overload]
        if check is None:
            return None
        try:
            payload, counter = decode(frame.arbitration_id, frame.data)
        except FrameRefusedError as error:
            self.refused[error.refusal] += 1
            return None
        if not check.accepts(counter):
            self.refused[Refusal.COUNTER] += 1
            return None
        return Received(FrameId(frame.arbitration_id), payload, frame.received_ns)
