# SPDX-License-Identifier: MIT
"""Both ends of the wheel board's conversation: counters put on and checked, everything refused counted."""

from collections import Counter
from typing import Protocol

from segway_ecc.firmware_io.drives.wheel_board.frames import FrameId, Payload, decode, encode
from segway_ecc.firmware_io.integrity import CounterCheck, FrameRefusedError, Refusal
from segway_ecc.firmware_io.links.link import Frame


class Sender(Protocol):
    """What an endpoint needs of a link."""

    def send(self, frame: Frame) -> bool:
        """Queue a frame; False where it was dropped."""


class Endpoint:
    """Sends payloads over a link and checks those that arrive.

    Attributes:
        refused: Frames refused, by cause.
    """

    def __init__(self, link: Sender, listen_to: frozenset[FrameId]) -> None:
        """Speak over `link`; frames with other ids than `listen_to` are somebody else's and are passed over."""
        self.refused: Counter[Refusal] = Counter()
        self._link = link
        self._send_counter = dict.fromkeys(FrameId, 0)
        self._ids = {int(frame_id): frame_id for frame_id in listen_to}
        self._checks = {frame_id: CounterCheck() for frame_id in listen_to}
        self._lost_before = 0

    @property
    def lost(self) -> int:
        """Frames missing between those received, by their counters."""
        return self._lost_before + sum(check.lost for check in self._checks.values())

    def send(self, frame_id: FrameId, payload: Payload) -> bool:
        """Send a payload; False where the link dropped it."""
        counter = self._send_counter[frame_id]
        self._send_counter[frame_id] = counter + 1
        return self._link.send(Frame(frame_id, encode(frame_id, payload, counter)))

    def restart(self) -> None:
        """Take the next frame of each identifier whatever its counter, as after a change to another line."""
        self._lost_before = self.lost
        self._checks = {frame_id: CounterCheck() for frame_id in self._checks}

    def check(self, frame: Frame) -> Payload | None:
        """What a frame carries that is listened to and intact; None for any other, counted where it was refused."""
        frame_id = None if frame.is_extended else self._ids.get(frame.arbitration_id)
        if frame_id is None:
            return None
        try:
            payload, counter = decode(frame_id, frame.data)
        except FrameRefusedError as error:
            self.refused[error.refusal] += 1
            return None
        if not self._checks[frame_id].accepts(counter):
            self.refused[Refusal.COUNTER] += 1
            return None
        return payload
