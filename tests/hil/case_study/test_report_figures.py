# SPDX-License-Identifier: MIT
import functools
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import replace

import matplotlib as mpl
import pytest

from segway_ecc.hil.case_study.report import errors_svg, graph_svg, path_svg, turn_svg, velocities_svg
from segway_ecc.hil.case_study.study import Cell, Edge, Seat, Trajectory, thesis_cells


def _circle(seat: Seat) -> Trajectory:
    time = [step / 10 for step in range(201)]
    return Trajectory(
        seat=seat,
        time=time,
        x=[2 * math.sin(t / 2) for t in time],
        y=[2 - 2 * math.cos(t / 2) for t in time],
        linear_velocity=[1.0] * len(time),
        angular_velocity=[0.5] * len(time),
    )


def _cells(*seats: Seat) -> list[Cell]:
    return [replace(cell, positions=dict.fromkeys(seats, cell.thesis_offline)) for cell in thesis_cells()]


_RUNS = [_circle(seat) for seat in Seat]
_EDGES = [
    Edge("/cart", "/odom", "nav_msgs/msg/Odometry", "/commander"),
    Edge("/cart", "/tf", "tf2_msgs/msg/TFMessage", "/commander"),
    Edge("/commander", "/cmd_vel", "geometry_msgs/msg/Twist", "/cart"),
]
_DRAWINGS: dict[str, Callable[[], str]] = {
    "velocities": lambda: velocities_svg(_RUNS),
    "path": lambda: path_svg(_RUNS),
    "turn": lambda: turn_svg(_RUNS),
    "errors": lambda: errors_svg(_cells(*Seat), list(Seat)),
    "graph": lambda: graph_svg(_EDGES),
}
_every_figure = pytest.mark.parametrize("name", _DRAWINGS)


@functools.cache
def _drawn(name: str) -> str:
    return _DRAWINGS[name]()


def _parse(svg: str) -> ET.Element:
    return ET.fromstring(svg)  # noqa: S314 - our own output


def _texts(svg: str) -> list[str]:
    return ["".join(element.itertext()).strip() for element in _parse(svg).iter() if element.tag.endswith("}text")]


def _ids(svg: str) -> list[str]:
    return [element.attrib["id"] for element in _parse(svg).iter() if "id" in element.attrib]


@_every_figure
def test_is_a_labelled_image_without_metadata(name: str) -> None:
    root = _parse(_drawn(name))
    assert root.tag == "{http://www.w3.org/2000/svg}svg"
    assert root.attrib["role"] == "img"
    assert root.attrib["aria-label"]
    assert not [element for element in root.iter() if element.tag.endswith(("metadata", "}style", "script"))]


@_every_figure
def test_refers_only_to_its_own_parts(name: str) -> None:
    svg = _drawn(name)
    references = set(re.findall(r'(?:href="|url\()#([^")]+)', svg))
    assert references <= set(_ids(svg))
    assert svg.count('href="') == svg.count('href="#')


@_every_figure
def test_is_the_same_every_time(name: str) -> None:
    assert _DRAWINGS[name]() == _drawn(name)


def test_no_two_figures_share_an_id() -> None:
    ids = [identifier for name in _DRAWINGS for identifier in _ids(_drawn(name))]
    assert len(ids) == len(set(ids))
    assert any(re.search(r"-p[0-9a-f]{10}$", identifier) for identifier in ids), "clip paths are among them"


def test_settings_are_left_as_they_were() -> None:
    before = dict(mpl.rcParams)
    velocities_svg(_RUNS)
    assert dict(mpl.rcParams) == before


@pytest.mark.parametrize("name", ["velocities", "path", "turn", "errors"])
def test_every_seat_is_in_the_legend(name: str) -> None:
    assert {"offline", "ros", "can"} <= set(_texts(_drawn(name)))


def test_axes_carry_their_units() -> None:
    assert {"linear velocity, m/s", "angular velocity, rad/s", "time, s"} <= set(_texts(_drawn("velocities")))
    assert {"x, m", "y, m", "start", "end"} <= set(_texts(_drawn("path")))


def test_identical_seats_are_drawn_with_different_widths() -> None:
    widths = set(re.findall(r"stroke-width: ([\d.]+)", _drawn("path")))
    assert {"6", "2.6", "1.3"} <= widths


def test_turn_marks_the_change_of_set_point() -> None:
    texts = " ".join(_texts(_drawn("turn")))
    assert "set-point becomes" in texts
    assert "10 s" in texts


def test_turn_that_ended_early_is_drawn() -> None:
    run = _circle(Seat.OFFLINE)
    short = replace(run, **{name: getattr(run, name)[:50] for name in ("time", "x", "y")})
    short = replace(short, linear_velocity=run.linear_velocity[:50], angular_velocity=run.angular_velocity[:50])
    assert "end" in _texts(turn_svg([short]))


def test_errors_name_every_cell_and_the_thesis_run() -> None:
    texts = _texts(errors_svg(_cells(Seat.OFFLINE), [Seat.OFFLINE, Seat.ROS]))
    assert {"0, 0", "6, 4", "thesis' own ROS run"} <= set(texts)


def test_graph_names_nodes_on_both_sides_and_each_topic_once() -> None:
    texts = _texts(graph_svg([*_EDGES, replace(_EDGES[0], subscriber="/recorder")]))
    assert texts.count("/cart") == 2
    assert texts.count("/recorder") == 1
    assert sum("/odom" in text for text in texts) == 1
    assert any("nav_msgs/msg/Odometry" in text for text in texts)


def test_graph_shows_names_as_they_are() -> None:
    edge = Edge('/a id="x', "/$x$ <script>", "url(#y)", "/b")
    svg = graph_svg([edge])
    assert "<script>" not in svg
    assert {'/a id="x', "/$x$ <script>"} <= set(_texts(svg))


def test_without_data_there_is_an_empty_figure() -> None:
    for svg in (velocities_svg([]), path_svg([]), turn_svg([]), graph_svg([])):
        assert _parse(svg).attrib["role"] == "img"
