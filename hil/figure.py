# SPDX-License-Identifier: MIT
"""A figure as an image inside a page, whose ids and styles touch no other."""

import base64
import io
from collections.abc import Callable, Mapping
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Draw = Callable[["Figure"], None]
"""Draws into an empty figure."""


def svg(name: str, size: tuple[float, float], draw: Draw, font_size: float = 10.0) -> bytes:
    """Draw a figure of a size, inches, as SVG; the same drawing gives the same bytes. `name` keeps its ids its own."""
    plain: dict[str, str | None] = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    settings = {"svg.hashsalt": name, "svg.fonttype": "none", "font.size": font_size}
    return _saved("svg", settings, plain, size, draw)


def png(size: tuple[float, float], draw: Draw, font_size: float = 10.0) -> bytes:
    """The same as an image of 150 points per inch."""
    return _saved("png", {"savefig.dpi": 150, "font.size": font_size}, {"Software": None}, size, draw)


def _saved(
    form: str,
    settings: Mapping[str, object],
    metadata: Mapping[str, str | None],
    size: tuple[float, float],
    draw: Draw,
) -> bytes:
    import matplotlib as mpl  # noqa: PLC0415 - an extra that all but figures does without
    from matplotlib.figure import Figure  # noqa: PLC0415

    every: dict[str, object] = {"font.family": "sans-serif", **settings}
    with mpl.rc_context(every):  # type: ignore[arg-type]  # each is one of its settings
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        data = io.BytesIO()
        figure.savefig(data, format=form, metadata=dict(metadata))
    return data.getvalue()


def image(name: str, label: str, size: tuple[float, float], draw: Draw) -> str:
    """The same as HTML, with a label for those who do not see it."""
    address = base64.b64encode(svg(name, size, draw)).decode("ascii")
    return f'<img alt="{escape(label)}" src="data:image/svg+xml;base64,{address}">\n'
