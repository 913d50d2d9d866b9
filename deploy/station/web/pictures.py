# SPDX-License-Identifier: MIT
"""Pictures on their way to a browser: few at a time, and always the newest next. Pure: time is given."""

import functools
import zlib
from collections import deque
from typing import Final, NamedTuple

import msgspec

from segway_ecc.deploy.station.views import FleetView

_MOST_UNSEEN: Final = 2
"""What is sent beyond that only waits in the buffers of a slow link, and grows old there."""
_QUICK_NS: Final = 300_000_000
"""From a picture to the browser's word that it has it; where it takes longer, one is on the way at a time."""
_QUICKLY: Final = 1


class Picture:
    """A picture as it is sent, to all alike: encoded once, and compressed once where somebody takes it so.

    Attributes:
        time_s: As in `FleetView`.
        encoded: JSON.
    """

    def __init__(self, view: FleetView) -> None:
        self.time_s = view.time_s
        self.encoded = msgspec.json.encode(view)

    @functools.cached_property
    def deflated(self) -> bytes:
        """The same, compressed (RFC 1950)."""
        return zlib.compress(self.encoded, _QUICKLY)


class _Unseen(NamedTuple):
    time_s: float
    sent_ns: int


class Pictures:
    """Those of one browser: the next one waits until the browser says that it has those before."""

    def __init__(self) -> None:
        self._waiting: Picture | None = None
        self._unseen: deque[_Unseen] = deque()
        self._took_ns: int | None = None

    @property
    def unseen_since_ns(self) -> int | None:
        """When the oldest that is on the way was sent; None where none is."""
        return self._unseen[0].sent_ns if self._unseen else None

    def put(self, picture: Picture) -> None:
        """Have a picture wait, in place of one that does."""
        self._waiting = picture

    def take(self, now_ns: int) -> Picture | None:
        """The picture to be sent now; None where none waits, or there is no room for it on the way."""
        picture = self._waiting
        if picture is None or not self._has_room():
            return None
        self._waiting = None
        self._unseen.append(_Unseen(picture.time_s, now_ns))
        return picture

    def on_seen(self, time_s: float, now_ns: int) -> float | None:
        """Make room, as a picture and those before have arrived; the time of the newest that was on the way, s."""
        newest_s = None
        while self._unseen and self._unseen[0].time_s <= time_s:
            newest_s, sent_ns = self._unseen.popleft()
            self._took_ns = now_ns - sent_ns
        return newest_s

    def _has_room(self) -> bool:
        is_quick = self._took_ns is not None and self._took_ns <= _QUICK_NS
        return len(self._unseen) < (_MOST_UNSEEN if is_quick else 1)
