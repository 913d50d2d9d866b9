# SPDX-License-Identifier: MIT
"""What the kernel knows of a network interface, asked off the loop."""

from collections.abc import Mapping

from segway_ecc.firmware_io.links.interface_state import UNKNOWN, InterfaceState, read_interface_state
from segway_ecc.firmware_io.links.reopening import BackgroundTask


class InterfaceWatch:
    """Keeps the newest answer, and asks again at each look; a bus that is no network interface is never asked about.

    Attributes:
        state: The newest answer.
    """

    def __init__(self, name: str | None) -> None:
        """Watch the network interface `name`."""
        self.state = UNKNOWN
        self._name = name
        self._task: BackgroundTask[InterfaceState] | None = None
        self._error_frames = 0

    def read(self) -> InterfaceState:
        """Ask now, and wait for the answer; for use off the loop."""
        return UNKNOWN if self._name is None else read_interface_state(self._name)

    def begin(self, state: InterfaceState) -> None:
        """Start from an answer, and discard the answer to an earlier question."""
        self.state = state
        self._task = None

    def look(self, error_frames: int) -> bool:
        """See whether an answer has come, and ask anew.

        Args:
            error_frames: How many have been received so far.

        Returns:
            Whether `state` is new, and was asked for after the last error frame had come.
        """
        if self._name is None:
            return False
        is_news = False
        if self._task is not None:
            answer = self._task.take_outcome()
            if answer is None:
                return False
            if isinstance(answer, InterfaceState):
                self.state = answer
                is_news = error_frames == self._error_frames
        self._error_frames = error_frames
        self._task = BackgroundTask(self.read)
        return is_news

    def as_text(self) -> Mapping[str, str]:
        """The interface in a few words; nothing for a bus that is none."""
        return {} if self._name is None else {"interface": str(self.state)}
