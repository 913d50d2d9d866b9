# SPDX-License-Identifier: MIT
"""Drawings of signals: what shares a panel, what is told in words, and whether all of it can be read."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from segway_ecc.hil.plants.segway import SegwayPlant
from segway_ecc.node.cli.panels import Signal, arranged, draw_panels, drawing
from segway_ecc.node.errors import ConfigurationError
from tests.drawn_texts import bare_axes, hard_numbers, outside, overlapping, texts_of

TIMES = [0.01 * step for step in range(301)]


def wave(largest: float, base: float = 0.0, phase: float = 0.0) -> list[float]:
    return [base + largest * math.sin(2.0 * t + phase) for t in TIMES]


def named(*signals: Signal, most: int = 6) -> list[list[str]]:
    return [[signal.name for signal in panel.signals] for panel in arranged(signals, most)[0]]


def figure_of(signals: Sequence[Signal], layers: Sequence[str] = ("",), times: Sequence[float] = TIMES) -> Figure:
    figure = drawing(times, signals, layers)
    assert figure is not None
    return figure


def labels_of(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes]


PLANT = [
    Signal(variable.name, variable.unit, [wave(10.0 ** (place % 4 - 2), phase=place)])
    for place, variable in enumerate(SegwayPlant.outputs)
]
PAIRS = [
    Signal(f"{side}_{end}.torque", "N m", [wave(1.0, phase=place), wave(1.0, phase=place)])
    for place, (side, end) in enumerate((side, end) for side in ("left", "right") for end in ("front", "rear"))
]
DRAWINGS: dict[str, Callable[[], Figure]] = {
    "a plant with many outputs": lambda: figure_of(PLANT),
    "pairs of curves": lambda: figure_of(PAIRS, ("recorded", "computed")),
    "all sizes": lambda: figure_of([Signal(f"s{e}", "m/s" if e % 2 else "kg", [wave(10.0**e)]) for e in range(-9, 10)]),
    "far from zero": lambda: figure_of(
        [Signal("x", "m", [wave(1e-4, 101325.4321)]), Signal("p", "Pa", [wave(2.0, 101325.0)])]
    ),
    "nothing changes": lambda: figure_of(
        [Signal(f"n{place}", "1", [[float(place)] * len(TIMES)]) for place in range(9)]
    ),
    "one sample": lambda: figure_of([Signal("x", "m", [[3.0]])], times=[0.0]),
    "not finite": lambda: figure_of([Signal("x", "m", [[math.nan, 1.0, math.inf, 2.0]])], times=[0.0, 1.0, 2.0, 3.0]),
    "hours": lambda: figure_of([Signal("x", "m", [wave(1.0)])], times=[288.0 * t for t in range(301)]),
    "long after the start": lambda: figure_of([Signal("x", "m", [wave(1.0)])], times=[50_000.0 + t for t in TIMES]),
    "a moment": lambda: figure_of([Signal("x", "m", [wave(1.0)])], times=[1e-3 * t for t in TIMES]),
    "long names": lambda: figure_of(
        [Signal("chassis.front_axle.wheel" * 6 + str(n), "N m s2/rad", [wave(n)]) for n in (1, 2)]
    ),
    "many that are still": lambda: figure_of(
        [Signal(f"still_{n}", "m", [[1.0] * len(TIMES)]) for n in range(60)] + PLANT[:2]
    ),
}


@pytest.mark.parametrize("name", DRAWINGS)
def test_every_drawing_can_be_read(name: str) -> None:
    figure = DRAWINGS[name]()
    texts = texts_of(figure)
    assert bare_axes(figure) == []
    assert overlapping(texts) == []
    assert outside(figure, texts) == []
    assert hard_numbers([text.text for text in texts]) == []
    assert sum(text.text.startswith("time") for text in texts) == 1


def test_signals_of_one_unit_share_a_panel_where_each_is_seen_to_move() -> None:
    assert named(
        Signal("x", "m", [wave(5.0)]),
        Signal("v", "m/s", [wave(1.0)]),
        Signal("y", "m", [wave(2.0)]),
        Signal("gap", "m", [wave(0.1)]),
        Signal("far", "m", [wave(2.0, base=100.0)]),
    ) == [["x", "y"], ["gap"], ["far"], ["v"]]


def test_a_panel_has_no_more_curves_than_are_told_apart() -> None:
    signals = [Signal(f"n{place}", "V", [wave(1.0)]) for place in range(7)]
    assert [len(panel) for panel in named(*signals)] == [6, 1]
    assert [len(panel) for panel in named(*signals, most=3)] == [3, 3, 1]
    assert max(len(axes.lines) for axes in DRAWINGS["pairs of curves"]().axes) == 6


def test_what_never_changes_is_told_in_words_and_rounding_is_no_change() -> None:
    panels, words = arranged(
        [
            Signal("x", "m", [wave(5.0)]),
            Signal("y", "m", [wave(1e-16)]),
            Signal("_phase", "1", [[2.0] * len(TIMES)]),
            Signal("lost", "1", [[math.nan] * len(TIMES)]),
        ],
        6,
    )
    assert [[signal.name for signal in panel.signals] for panel in panels] == [["x"]]
    assert words == ["Does not change: y 0 m, _phase 2", "Has no finite value: lost"]


def test_where_nothing_changes_values_are_drawn_all_the_same() -> None:
    panels, words = arranged([Signal("a", "V", [[0.0, 0.0]]), Signal("b", "V", [[3.0, 3.0]])], 6)
    assert [[signal.name for signal in panel.signals] for panel in panels] == [["a", "b"]]
    assert words == ["Does not change: a 0 V, b 3 V"]


@pytest.mark.parametrize(
    ("unit", "largest", "base", "label"),
    [
        ("m/s", 2.0, 0.0, "m/s"),
        ("1", 2.0, 0.0, "no unit"),
        ("", 2.0, 0.0, ""),
        ("rad", 1.46e-8, 0.0, "nrad"),
        ("m", 1e-4, 1000.0, "\u00b5m\nfrom 1000 m"),
        ("$m$", 1.0, 0.0, r"\$m\$"),
    ],
)
def test_an_axis_has_its_unit_with_a_prefix_where_that_helps(
    unit: str, largest: float, base: float, label: str
) -> None:
    assert labels_of(figure_of([Signal("x", unit, [wave(largest, base)])])) == [label]


@pytest.mark.parametrize(
    ("first", "last", "label"),
    [
        (0.0, 10.0, "time, s"),
        (0.0, 0.05, "time, ms"),
        (0.0, 1800.0, "time, min"),
        (0.0, 86_400.0, "time, h"),
        (5000.0, 5002.0, "time from 5000 s on, s"),
        (0.0, 0.0, "time, s"),
    ],
)
def test_time_is_named_once_in_the_unit_that_fits(first: float, last: float, label: str) -> None:
    figure = figure_of([Signal("x", "m", [[1.0, 2.0]]), Signal("v", "m/s", [[1.0, 2.0]])], times=[first, last])
    assert [axes.get_xlabel() for axes in figure.axes] == ["", label]


def test_of_curves_that_are_the_same_each_is_seen() -> None:
    recorded, computed = DRAWINGS["pairs of curves"]().axes[0].lines[:2]
    assert recorded.get_linewidth() > 2.0 * computed.get_linewidth()
    assert [line.get_label() for line in (recorded, computed)] == [
        "left_front.torque, recorded",
        "left_front.torque, computed",
    ]
    alike = figure_of([Signal("a", "m", [wave(1.0)]), Signal("b", "m", [wave(1.0)])]).axes[0].lines
    assert len({str(line.get_linestyle()) for line in alike}) == 2


def test_nothing_is_a_formula_and_no_name_is_left_out() -> None:
    texts = [text.text for text in texts_of(figure_of([Signal("_$a$", "m", [wave(1.0)])]))]
    assert any("_" in text and "a" in text for text in texts)


def test_a_file_is_written_in_the_format_of_its_name(tmp_path: Path) -> None:
    draw_panels(tmp_path / "a.png", TIMES, PLANT)
    draw_panels(tmp_path / "a.svg", TIMES, PLANT)
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert b"<svg" in (tmp_path / "a.svg").read_bytes()


@pytest.mark.parametrize("signals", [[], [Signal("x", "m", [[math.nan] * len(TIMES)])]])
def test_a_drawing_of_nothing_is_refused(tmp_path: Path, signals: Sequence[Signal]) -> None:
    with pytest.raises(ConfigurationError, match=r"cannot draw .*: there is no signal with a value"):
        draw_panels(tmp_path / "a.png", TIMES, signals)
    assert list(tmp_path.iterdir()) == []
