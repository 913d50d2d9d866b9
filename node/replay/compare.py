# SPDX-License-Identifier: MIT
"""Two cycles compared, to the last bit."""

import struct
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from segway_ecc.node.cycle.interfaces import CycleRecord
from segway_ecc.node.recording.layout import CycleLayout


class Difference(NamedTuple):
    """What differs first in a cycle.

    Attributes:
        cycle: Its number.
        time_s: Since the first cycle, s.
        port: What differs: a command, a model's port, the mode.
        recorded: What it was.
        computed: What it is now.
    """

    cycle: int
    time_s: float
    port: str
    recorded: str
    computed: str

    def __str__(self) -> str:
        """In one line."""
        return (
            f"cycle {self.cycle} (t = {self.time_s:.3f} s): {self.port} {self.recorded} was recorded, "
            f"{self.computed} is computed"
        )


def differences(layout: CycleLayout, recorded: CycleRecord, computed: CycleRecord) -> Iterator[tuple[str, str, str]]:
    """What differs between a cycle as recorded and as computed: the port and both values; commands first."""
    pairs = (
        ("command", layout.commands, recorded.commands, computed.commands),
        ("model input", layout.inputs, recorded.u, computed.u),
        ("model output", layout.outputs, recorded.y, computed.y),
        ("set-point", recorded.setpoint._fields, recorded.setpoint, computed.setpoint),
        ("published", layout.published, recorded.published, computed.published),
    )
    for kind, names, old, new in pairs:
        if same(old, new):
            continue
        for name, a, b in zip(names, old, new, strict=True):
            if not same((a,), (b,)):
                yield f"{kind} {name}", repr(float(a)), repr(float(b))
    if recorded.mode is not computed.mode:
        yield "mode", str(recorded.mode), str(computed.mode)


def same(a: Sequence[float], b: Sequence[float]) -> bool:
    """Whether numbers are the same bit for bit; what is not a number is the same as what is none."""
    if len(a) != len(b):
        return False
    layout = struct.Struct(f"{len(a)}d")
    if layout.pack(*a) == layout.pack(*b):
        return True
    pairs = zip(a, b, strict=True)
    return all((x != x and y != y) or struct.pack("d", x) == struct.pack("d", y) for x, y in pairs)  # noqa: PLR0124 - NaN
