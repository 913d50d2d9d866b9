# SPDX-License-Identifier: MIT
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser

import pytest

from segway_ecc.hil.case_study.report import render
from segway_ecc.hil.case_study.study import Edge, LoopTiming, RealTimeRun, Seat, Study, Trajectory, thesis_cells

_VOID = {"meta", "link", "img", "br", "hr"}


class _Page(HTMLParser):
    """Collects what a page holds and fails where its tags do not match."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in _VOID:
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in {"th", "td"}:
            self.rows[-1].append("")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text += data
        if self.open and self.open[-1] in {"th", "td"}:
            self.rows[-1][-1] += data


def _trajectory(seat: Seat) -> Trajectory:
    time = [step / 5 for step in range(101)]
    x = [2 * math.sin(t / 2) for t in time]
    y = [2 - 2 * math.cos(t / 2) for t in time]
    return Trajectory(seat, time, x, y, [1.0] * len(time), [0.5] * len(time))


def study_of(*seats: Seat) -> Study:
    cells = [
        replace(cell, positions=dict.fromkeys(seats, (cell.thesis_offline[0] + 0.00123, cell.thesis_offline[1])))
        for cell in thesis_cells()
    ]
    runs = [_trajectory(seat) for seat in seats]
    graph = [Edge("/cart", "/odom", "nav_msgs/msg/Odometry", "/commander")]
    return Study(cells, seats, runs, runs, graph, {"Version": "1.2.3"})


def _items(text: str) -> list[str]:
    return re.findall(r"<li>(.*?)</li>", text)


def _body_rows(text: str) -> Sequence[list[str]]:
    return [row for row in _Page(text).rows if row[0].isdigit()]


@pytest.fixture(scope="module")
def full() -> str:
    return render(study_of(*Seat))


def test_tags_are_balanced(full: str) -> None:
    assert _Page(full).tags.count("table") == 1


def test_holds_five_well_formed_figures(full: str) -> None:
    svgs = re.findall(r"<svg.*?</svg>", full, flags=re.DOTALL)
    assert len(svgs) == _Page(full).tags.count("figcaption") == 5
    for svg in svgs:
        assert ET.fromstring(svg).attrib["role"] == "img"  # noqa: S314 - our own output


def test_ids_are_unique(full: str) -> None:
    ids = [value for name, value in _Page(full).attributes if name == "id"]
    assert ids
    assert len(ids) == len(set(ids))


def test_loads_nothing(full: str) -> None:
    page = _Page(full)
    assert not {"script", "link", "img", "iframe", "object", "image"} & set(page.tags)
    references = [value or "" for name, value in page.attributes if name in {"src", "href", "xlink:href"}]
    assert all(value.startswith("#") for value in references)
    assert "@import" not in full
    assert not re.search(r"url\((?!#)", full)
    assert set(re.findall(r"https?://[^\"]*", full)) == {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}


def test_is_the_same_every_time(full: str) -> None:
    assert render(study_of(*Seat)) == full


def test_rows_hold_the_numbers_of_the_study(full: str) -> None:
    rows = _body_rows(full)
    assert len(rows) == 12
    assert rows[5][:5] == ["2", "4", "0.43, 0.76", "0.49, 0.60", "0.4312, 0.7600"]
    assert rows[5][4 + len(Seat) :] == ["0.1600", *["0.0012"] * len(Seat)]


def test_every_heading_of_the_table_has_a_scope(full: str) -> None:
    headings = re.findall(r"<th\b[^>]*>", full)
    assert headings
    assert all("scope=" in heading for heading in headings)


def test_verdict_names_the_worst_difference_of_each_seat(full: str) -> None:
    offline, submodel, ros, can, sameness = _items(full)
    assert submodel.startswith("The submodel seat: 0.0012 m")
    assert offline.startswith("The offline seat: 0.0012 m in 12 of 12 cells, smaller than")
    assert ros.startswith("The ros seat: 0.0012 m")
    assert can.startswith("The can seat: 0.0012 m")
    assert sameness == "The ros seat equals the offline seat to the last bit in every one of the 12 cells both ran."


def test_verdict_reports_a_difference_in_the_last_bit() -> None:
    study = study_of(Seat.OFFLINE, Seat.ROS)
    x, y = study.cells[5].positions[Seat.OFFLINE]
    off = replace(study.cells[5], positions={Seat.OFFLINE: (x, y), Seat.ROS: (math.nextafter(x, 1), y)})
    sameness = _items(render(replace(study, cells=[*study.cells[:5], off, *study.cells[6:]])))[-1]
    assert "does not equal" in sameness
    assert "1 of 12 cells" in sameness
    assert f"{math.ulp(x):.3g} m" in sameness


def test_verdict_does_not_praise_a_seat_that_is_far_off() -> None:
    study = study_of(Seat.OFFLINE)
    cells = [replace(cell, positions={Seat.OFFLINE: (100.0, 0.0)}) for cell in study.cells]
    assert "not smaller than" in _items(render(replace(study, cells=cells)))[0]


def test_a_seat_that_did_not_run_is_stated() -> None:
    text = render(replace(study_of(Seat.OFFLINE), graph=[]))
    assert _items(text)[1:4] == [f"The {seat} seat did not run." for seat in ("submodel", "ros", "can")]
    assert "not known" in _items(text)[4]
    assert "No ROS graph was recorded." in text
    assert len(_body_rows(text)[0]) == 7


def test_a_cell_that_a_seat_skipped_is_stated() -> None:
    study = study_of(Seat.OFFLINE, Seat.CAN)
    cells = [replace(study.cells[0], positions={}), *study.cells[1:]]
    assert _body_rows(render(replace(study, cells=cells)))[0].count("not run") == 4


def test_the_run_in_real_time_and_what_was_repeated_are_stated(full: str) -> None:
    real = RealTimeRun("1 m/s", LoopTiming(0.0001, 0.002, 3, 0.25), 0.0125)
    causes = ["ros turn, try 1 of 3: lost", "ros turn, try 2 of 3: lost"]
    text = render(replace(study_of(Seat.CAN), real_time=real, repeated=causes))

    assert _items(text)[-1] == real.text
    assert f"<dt>Repeated runs</dt>\n<dd>{' | '.join(causes)}</dd>" in text
    assert "<dt>Repeated runs</dt>\n<dd>none</dd>" in full


def test_text_is_escaped() -> None:
    script = "<script>alert('&')</script>"
    study = replace(study_of(Seat.OFFLINE), facts={script: script}, graph=[Edge(script, script, script, script)])
    text = render(study)
    assert "<script" not in text
    assert _Page(text).text.count(script) >= 2


def test_an_empty_study_is_a_page() -> None:
    page = _Page(render(Study([], [], [], [], [], {})))
    assert "svg" not in page.tags
    assert "nothing to compare" in page.text
