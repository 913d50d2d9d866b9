# SPDX-License-Identifier: MIT
"""What the robot reports to the machine that asked: one JSON object a line."""

import contextlib
import json
from typing import Any, BinaryIO


class Reporter:
    """Writes events; while it is attached, a listener that has gone ends what is going on.

    Args:
        stream: Where the lines go.
    """

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self._is_attached = True

    def detach(self) -> None:
        """From now on it does not matter whether anybody listens."""
        self._is_attached = False

    def step(self, name: str) -> None:
        """A step begins."""
        self.event("step", step=name)

    def event(self, event: str, **values: Any) -> None:  # noqa: ANN401 - whatever JSON can hold
        """Send an event."""
        line = json.dumps({"event": event, **values}).encode() + b"\n"
        with contextlib.suppress(*(() if self._is_attached else (OSError, ValueError))):
            self._stream.write(line)
            self._stream.flush()
