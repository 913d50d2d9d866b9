"""What the process that writes a log is told, apart from it: whoever starts one needs none of what writing takes."""

from typing import Final

import msgspec

from node.recording.bounds import Bounds
from node.recording.layout import Layout
from node.recording.provenance import Provenance

SLOTS: Final = 1024
"""Of the ring between the loop and the writer: room for 10 s at 100 Hz while a disk is busy."""


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
