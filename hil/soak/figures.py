# SPDX-License-Identifier: MIT
"""The figure of a soak: how each quantity went over time, from its value at the end of the warm-up."""

from collections.abc import Sequence
from typing import Final

from matplotlib.figure import Figure

from segway_ecc.hil.figure import svg
from segway_ecc.hil.soak.watching import WARM_UP, Series, judge

_BAD: Final = "#b3261e"
_GOOD: Final = "#2e6f9e"
_GREY: Final = "#6b6b6b"
_HEIGHT: Final = 1.5
_COLUMNS: Final = 3


def figure(series: Sequence[Series]) -> bytes:
    """Draw every series in a panel of its own, as SVG; what grew is red."""
    rows = -(-len(series) // _COLUMNS)

    def draw(figure: Figure) -> None:
        panels = figure.subplots(rows, _COLUMNS, squeeze=False)
        for panel in panels.flat[len(series) :]:
            panel.set_visible(False)
        for panel, one in zip(panels.flat, series, strict=False):
            minutes = [time_s / 60.0 for time_s in one.times_s]
            panel.plot(minutes, one.values, color=_BAD if judge(one).is_growing else _GOOD, linewidth=1)
            panel.axvspan(minutes[0], minutes[0] + WARM_UP * (minutes[-1] - minutes[0]), color="#eeeeee", linewidth=0)
            if one.most is not None:
                panel.axhline(one.most, color=_GREY, linestyle="--", linewidth=1)
            panel.set_title(f"{one.process}: {one.quantity}{f', {one.unit}' if one.unit else ''}", fontsize=9)
            panel.tick_params(labelsize=8)
            panel.margins(y=0.2)
            panel.ticklabel_format(axis="y", useOffset=False)
        figure.supxlabel("time, min; grey: the warm-up, which is not judged")

    return svg("soak", (12.0, 0.6 + _HEIGHT * rows), draw)
