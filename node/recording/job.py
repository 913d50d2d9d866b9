"""What the process that writes a log is told, apart from it: whoever starts one needs none of what writing takes."""

from typing import Final

import msgspec

from segway_ecc.node.recording.bounds import Bounds
from segway_ecc.node.recording.layout import Layout
from segway_ecc.node.recording.provenance import Provenance
from segway_ecc.node.ring import slots_for

_BUSY_NS: Final = 5_000_000_000
"""So long a disk may be busy."""
_FEWEST: Final = 256
_MOST: Final = 1024
_DIAGNOSTICS_BYTES: Final = 65_536
"""Of as long."""


def ring_slots(period_ns: int, cycle_bytes: int) -> int:
    """Slots of the ring between the loop and the writer, for what comes while a disk is busy.

    Args:
        period_ns: Of the loop; 0 where it is not known.
        cycle_bytes: What a cycle takes; there is room for 256 to 1,024 of them.
    """
    cycles = min(max(_BUSY_NS // period_ns, _FEWEST), _MOST) if period_ns else _MOST
    return cycles * slots_for(cycle_bytes) + slots_for(_DIAGNOSTICS_BYTES)


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
