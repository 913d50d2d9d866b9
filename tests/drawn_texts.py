# SPDX-License-Identifier: MIT
"""What is written in a figure, line by line with where it stands, as it is drawn; and whether that can be read."""

import math
import re
from collections.abc import Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TOUCHING = 0.5
"""Pixels that two lines may share: boxes are rounded to whole ones."""
_MOST_DIGITS = 4
_TINY = 1e-5
_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[-+]?\d+)?")


class DrawnText(NamedTuple):
    """A line of text, with its box, pixels from the upper left corner."""

    text: str
    left: float
    top: float
    right: float
    bottom: float

    def overlaps(self, other: "DrawnText") -> bool:
        across = min(self.right, other.right) - max(self.left, other.left)
        down = min(self.bottom, other.bottom) - max(self.top, other.top)
        return across > _TOUCHING and down > _TOUCHING


def texts_of(figure: "Figure") -> list[DrawnText]:
    """Every line that is drawn: what is there and hidden, such as a mark out of sight, is not."""
    from matplotlib.backends import backend_agg  # noqa: PLC0415 - slow to import

    library: Any = backend_agg  # has no types
    found: list[DrawnText] = []
    canvas = library.FigureCanvasAgg(figure)
    canvas.draw()  # which lays it out
    renderer = library.RendererAgg(*canvas.get_width_height(), figure.dpi)
    draw_text = renderer.draw_text

    def listen(*how: Any, **more: Any) -> None:
        _, x, y, text, font, angle = how[:6]
        width, height, descent = renderer.get_text_width_height_descent(text, font, ismath=more.get("ismath", False))
        turn = math.radians(angle)
        corners = [
            (x + across * math.cos(turn) - up * math.sin(turn), y - across * math.sin(turn) - up * math.cos(turn))
            for across in (0.0, width)
            for up in (-descent, height - descent)
        ]
        xs, ys = zip(*corners, strict=True)
        found.append(DrawnText(text, min(xs), min(ys), max(xs), max(ys)))
        draw_text(*how, **more)

    renderer.draw_text = listen
    figure.draw(renderer)
    return found


def overlapping(texts: Sequence[DrawnText]) -> list[tuple[str, str]]:
    """Lines of which one stands on the other."""
    return [(one.text, other.text) for one, other in combinations(texts, 2) if one.overlaps(other)]


def outside(figure: "Figure", texts: Sequence[DrawnText]) -> list[str]:
    """Lines that are cut off at an edge."""
    width, height = figure.get_size_inches() * figure.dpi
    return [t.text for t in texts if t.left < -1.0 or t.top < -1.0 or t.right > width + 1.0 or t.bottom > height + 1.0]


def hard_numbers(texts: Sequence[str]) -> list[str]:
    """Numbers with an exponent, with more than four digits that count, or with many zeros before them."""
    numbers = [number for text in texts for number in _NUMBER.findall(text)]
    digits = {number: number.replace(".", "").strip("0") for number in numbers}
    return [n for n in numbers if "e" in n or len(digits[n]) > _MOST_DIGITS or (digits[n] and float(n) < _TINY)]


def bare_axes(figure: "Figure") -> list[str]:
    """Axes, by their labels, in which there is nothing to see."""
    return [axes.get_ylabel() for axes in figure.axes if not (axes.patches or any(map(_is_seen, axes.lines)))]


def _is_seen(line: Any) -> bool:
    low, high = line.axes.get_ylim()
    return any(low <= value <= high for value in line.get_ydata())
