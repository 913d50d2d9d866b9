# SPDX-License-Identifier: MIT
"""The call into a model that a process is in: recorded in a page of memory that its watchdog has mapped too.

Recording it takes no system call, and the page outlives the process that wrote it.
"""

import enum
import mmap
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

_HEAD: Final = struct.Struct("<Bxxxxxxxqq")
"""The call, the number of the cycle, and since when, ns of the monotonic clock."""
MOST_INPUTS: Final = (mmap.PAGESIZE - _HEAD.size) // 8
"""How many inputs are kept; the first ones where a model has more."""

_SHOWN_INPUTS: Final = 12


@enum.unique
class Call(enum.IntEnum):
    """A call into a model."""

    NONE = 0
    """The model is not being called."""
    LOAD = 1
    INITIALIZE = 2
    STEP = 3
    TERMINATE = 4
    WRITE = 5
    READ = 6
    SAVE = 7
    RESTORE = 8


NAMES: Final = {
    Call.LOAD: "while it was loaded",
    Call.INITIALIZE: "in its initial equations",
    Call.STEP: "in its step",
    Call.TERMINATE: "in its final equations",
    Call.WRITE: "in a write to it",
    Call.READ: "in a read of it",
    Call.SAVE: "while its state was saved",
    Call.RESTORE: "while its state was restored",
}


class Seen(NamedTuple):
    """What the page holds: the call, the number of its cycle, and since when, ns."""

    call: Call
    cycle: int
    since_ns: int


class CallPage:
    """The page, on either side of it."""

    __slots__ = ("_inputs", "_map", "_pack", "_pack_inputs")

    def __init__(self, descriptor: int, inputs: int = 0) -> None:
        """Map the page of a model with so many inputs."""
        self._map = mmap.mmap(descriptor, mmap.PAGESIZE)
        self._pack = _HEAD.pack_into
        self.resize(inputs)

    def resize(self, inputs: int) -> None:
        """Keep so many inputs from now on."""
        values = f"{min(inputs, MOST_INPUTS)}d"
        self._inputs = struct.Struct(f"<{values}")
        self._pack_inputs = struct.Struct(f"{_HEAD.format}{values}").pack_into

    def enter(self, call: Call, cycle: int, now_ns: int) -> None:
        """Record a call that begins."""
        self._pack(self._map, 0, call, cycle, now_ns)

    def enter_with(self, call: Call, cycle: int, now_ns: int, u: Sequence[float]) -> None:
        """Record a call that begins under these inputs."""
        self._pack_inputs(self._map, 0, call, cycle, now_ns, *u[:MOST_INPUTS])

    def leave(self) -> None:
        """Record that the call has ended."""
        self._map[0] = 0

    def look(self) -> Seen:
        """What it holds now."""
        call, cycle, since_ns = _HEAD.unpack_from(self._map)
        # A model that writes where it should not may have written here.
        return Seen(Call(call) if call < len(Call) else Call.NONE, cycle, since_ns)

    def inputs_text(self, names: Sequence[str]) -> str:
        """The inputs of the newest call that had any, with their names; of many the first."""
        pairs = list(zip(names, self.inputs(), strict=False))
        shown = ", ".join(f"{name} {value!r}" for name, value in pairs[:_SHOWN_INPUTS])
        more = f" and {len(names) - _SHOWN_INPUTS} more" if len(names) > _SHOWN_INPUTS else ""
        return f"last inputs: {shown}{more}" if shown else "it has no inputs"

    def inputs(self) -> tuple[float, ...]:
        """The inputs of the newest call that had any."""
        return self._inputs.unpack_from(self._map, _HEAD.size)
