# SPDX-License-Identifier: MIT
"""The measure itself: it sees what collides, is cut off, is empty or hard to read, and nothing else."""

from matplotlib.figure import Figure

from tests.drawn_texts import bare_axes, hard_numbers, outside, overlapping, texts_of


def test_texts_are_found_where_they_stand() -> None:
    figure = Figure(figsize=(4.0, 2.0), dpi=100)
    figure.text(0.5, 0.5, "flat", va="baseline")
    figure.text(0.1, 0.5, "upright", rotation=90, va="bottom")
    figure.text(0.1, 0.9, "unseen", visible=False)
    flat, upright = sorted(texts_of(figure))
    assert (flat.text, upright.text) == ("flat", "upright")
    assert abs(flat.left - 200.0) < 2.0
    assert abs(flat.bottom - 100.0) < 5.0
    assert flat.right - flat.left > flat.bottom - flat.top
    assert upright.right - upright.left < upright.bottom - upright.top


def test_lines_that_collide_or_are_cut_off_are_named() -> None:
    figure = Figure(figsize=(4.0, 2.0), dpi=100)
    for x, y, text in ((0.1, 0.5, "one"), (0.11, 0.52, "two"), (0.5, 0.5, "three"), (0.95, 0.2, "too far right")):
        figure.text(x, y, text)
    texts = texts_of(figure)
    assert overlapping(texts) == [("one", "two")]
    assert outside(figure, texts) == ["too far right"]


def test_axes_without_a_curve_are_bare() -> None:
    figure = Figure()
    full, empty, lost = figure.subplots(3, 1)
    full.plot([0.0, 1.0])
    lost.plot([float("nan")] * 2)
    empty.set_ylabel("empty")
    lost.set_ylabel("lost")
    assert bare_axes(figure) == ["empty", "lost"]


def test_numbers_of_more_than_four_digits_or_with_an_exponent_are_hard() -> None:
    easy = ["1.234", "0.0001234 and 120000", "-0.5", "0", "0.0"]
    hard = ["12.345", "1.46e-08", "0.0000000146"]
    assert hard_numbers([*hard, *easy]) == hard
