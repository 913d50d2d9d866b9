"""What the process that writes a log is told, apart from it: whoever starts one needs none of what writing takes."""

from typing import Final

import msgspec

from node.recording.bounds import Bounds
from node.recording.layout import Layout
from node.recording.provenance import Provenance

_BUSY_NS: Final = 5_000_000_000
"""So long a disk may be busy."""
_FEWEST_SLOTS: Final = 256
_MOST_SLOTS: Final = 1024


def ring_slots(period_ns: int) -> int:
    """Slots of the ring between the loop and the writer: for the cycles of 5 s, within bounds; 0 is no known period."""
    return min(max(_BUSY_NS // period_ns, _FEWEST_SLOTS), _MOST_SLOTS) if period_ns else _MOST_SLOTS


class Job(msgspec.Struct, frozen=True):
    """What the writer is told first, as one line of JSON.

    Attributes:
        path: The log to write.
        layout: Names of what each cycle holds.
        provenance: Where the run comes from.
        bounds: How much room it may take.
    """

    path: str
    layout: Layout
    provenance: Provenance
    bounds: Bounds
