# SPDX-License-Identifier: MIT
"""Many cycles of a log at once, as a table of numbers: for what looks at all of them, and needs none as an object."""

from collections.abc import Sequence
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from segway_ecc.node.cycle.interfaces import PHASES
from segway_ecc.node.errors import RecordingError
from segway_ecc.node.recording.layout import CycleLayout

CycleTable: TypeAlias = NDArray[np.void]
"""A row for each cycle; its fields are those of `/cycle`, groups of numbers as one field each."""
_PHASES: Final = len(PHASES) - 1  # the last is the recording itself, see `cycle_message`


class CycleTableReader:
    """Reads the messages that `CycleMessage` packs."""

    def __init__(self, layout: CycleLayout) -> None:
        """Read those of a robot with this layout."""
        groups: Sequence[tuple[str, Sequence[str]]] = (
            ("sensor", layout.sensors),
            ("age_s", layout.sensors),
            ("model_input", layout.inputs),
            ("model_output", layout.outputs),
            ("command", layout.commands),
            ("published", layout.published),
        )
        self.row: Final = np.dtype(
            [
                ("encapsulation", "S4"),
                ("stamp_s", "<i4"),
                ("stamp_ns", "<u4"),
                ("frame", "S8"),
                ("cycle", "<u8"),
                ("start_ns", "<i8"),
                ("lateness_ns", "<i8"),
                ("duration_ns", "<i8", (_PHASES,)),
                ("setpoint", "<f8", (2,)),
                *((name, "<f8", (len(signals),)) for name, signals in groups),
                ("events", "<u4"),
                ("mode", "u1"),
                ("ready", "?"),
                ("off", "?"),
                ("valid", "?", (len(layout.sensors),)),
            ]
        )

    def table(self, messages: Sequence[bytes]) -> CycleTable:
        """The cycles in messages, a row each.

        Raises:
            RecordingError: They are of another robot.
        """
        if any(len(message) != self.row.itemsize for message in messages):
            raise RecordingError("the log does not hold the cycles of its layout")
        return np.frombuffer(b"".join(messages), self.row)
