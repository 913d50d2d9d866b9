"""What the process that writes a log is told, apart from it: whoever starts one needs none of what writing takes."""

import msgspec

from node.recording.bounds import Bounds
from node.recording.layout import Layout
from node.recording.provenance import Provenance


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
