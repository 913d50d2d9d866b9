# SPDX-License-Identifier: MIT
"""Tables of plain text, for terminals."""

from collections.abc import Sequence


def aligned(rows: Sequence[Sequence[str]], left: int | None = None) -> list[str]:
    """Lay out rows of one length, the head among them, as lines with aligned columns.

    The first `left` columns are aligned to the left, the others to the right; None for all to the left.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    sides = ["<" if left is None or place < left else ">" for place in range(len(widths))]
    return [
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths, strict=True)).rstrip()
        for row in rows
    ]
