# SPDX-License-Identifier: MIT
"""What a loop records of each of its cycles; its users need nothing else of the bench."""

from typing import Final

COLUMNS: Final = ("deadline", "start", "cpu", "bus", "model", "ros", "cycle")
"""Of a sample, each ns in a signed 64-bit integer of this machine: when the cycle was due and when it started
(monotonic), the CPU time that its thread had used by then, the wall time of its parts (0 where it has none, or does not
measure it), and the wall time of all it did."""
