# SPDX-License-Identifier: MIT
"""The figures of the report: full at every size of the study, and readable."""

from typing import TYPE_CHECKING

import pytest
from matplotlib.figure import Figure
from msgspec.structs import replace

from segway_ecc.hil.placement.grid import NETWORKS
from segway_ecc.hil.placement.judging import RunOutcome
from segway_ecc.hil.placement.report import FIGURES, StudyFigure, render, stop_bars
from segway_ecc.hil.placement.results import PLACEMENTS, Bound, Placement, StudyResult
from tests.drawn_texts import hard_numbers, outside, overlapping, texts_of
from tests.hil.placement.scripted import R, S, drive, found, stop

if TYPE_CHECKING:
    from tests.drawn_texts import DrawnText

DELAY = Bound(
    robot="segway",
    what="delay there and back, together, from before it stands up",
    unit="s",
    tolerated=0.0,
    lost=0.032,
    lost_by="",
    theory=0.0319,
)


def study(networks: list[str], placements: list[Placement], *bounds: Bound) -> StudyResult:
    """A study of which the robot falls where balance control is not on board."""
    cells = [(choice[:3], name, way) for name in networks for choice in placements for way in ways(choice)]
    fell = {True: RunOutcome.NEVER_STOOD, False: RunOutcome.DROVE_ON}
    drives = [drive(places, name, way, fell[places[1] is S], 0.0123) for places, name, way in cells]
    stops = [
        stop(places, None if places[1] is S else 0.0605, network=name, setpoints=way, outcome=fell[places[1] is S])
        for places, name, way in cells
    ]
    return found(*drives, *stops, *bounds)


def ways(placement: Placement) -> tuple[str, ...]:
    return ("cmd_vel_stamped", "cmd_vel") if placement.sequence_crosses else ("",)


QUICK = study(["50 ms"], [PLACEMENTS[0], PLACEMENTS[5], PLACEMENTS[7]], DELAY)
WHOLE = study(
    list(NETWORKS),
    list(PLACEMENTS),
    *(replace(DELAY, tolerated=0.001 * n, lost=0.001 * n + 0.001 if n % 2 else None) for n in range(9)),
)
EACH = pytest.mark.parametrize("figure", FIGURES, ids=[figure.name for figure in FIGURES])


def drawn(figure: StudyFigure, result: StudyResult) -> "tuple[Figure, list[DrawnText]]":
    canvas = Figure(figsize=figure.size(result), layout="constrained")
    figure.draw(result, canvas)
    return canvas, texts_of(canvas)


@EACH
@pytest.mark.parametrize("result", [QUICK, WHOLE], ids=["quick", "whole"])
def test_every_figure_can_be_read_at_its_size(figure: StudyFigure, result: StudyResult) -> None:
    canvas, texts = drawn(figure, result)
    assert overlapping(texts) == []
    assert outside(canvas, texts) == []
    assert hard_numbers([text.text for text in texts]) == []


@EACH
def test_a_figure_is_as_large_as_what_it_shows(figure: StudyFigure) -> None:
    canvas, _ = drawn(figure, QUICK)
    assert figure.size(QUICK)[1] < 0.5 * figure.size(WHOLE)[1]
    (axes,) = canvas.axes
    drawn_in = canvas.bbox.width * canvas.bbox.height
    assert axes.get_window_extent().width * axes.get_window_extent().height > 0.1 * drawn_in
    assert axes.patches or axes.collections


def test_a_stop_that_crosses_the_network_has_its_bar_whoever_sends_the_set_points() -> None:
    assert stop_bars(QUICK) == [
        (
            "50 ms",
            [
                ("nothing crosses the network", 0.0605, ""),
                ("the stop crosses it", 0.0605, ""),
                ("the commands cross it", None, "never stood up"),
            ],
        )
    ]


def test_the_longest_of_the_placements_with_the_same_flows_is_shown_and_one_that_did_nothing_goes_first() -> None:
    result = found(
        drive((R, R, S), "n"),
        stop((R, R, S), 0.05, 0.06, network="n"),
        stop((S, R, S), 0.09, network="n", setpoints="cmd_vel"),
    )
    assert stop_bars(result) == [("n", [("the stop crosses it", 0.09, "")])]
    worse = found(*result.drives, *result.stops, stop((R, R, S), 0.05, None, network="n"))
    assert stop_bars(worse) == [("n", [("the stop crosses it", None, "no stop")])]


def test_between_what_was_tolerated_and_lost_is_shown_as_such() -> None:
    _, texts = drawn(FIGURES[-1], QUICK)
    assert "0 to 32" in {text.text for text in texts}
    assert sum(text.text == "delay margin of the design" for text in texts) == 1


def test_a_figure_without_data_is_left_out() -> None:
    assert render(found(drive((R, R, R))), {}).count("<img") == 1
    assert render(QUICK, {}).count("<img") == 3
